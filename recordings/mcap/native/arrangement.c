/* What becomes of a chunk's messages, to the same bytes as NumPy makes of them, which is the oracle:
 *
 *   order     by (time, place of the topic, sequence), then by their bytes
 *   records   each after the 31 bytes that stand before it in a file
 *   index     of each channel, in the order of their first messages: (time, place of the record)
 *   stream    what the digest is over: topic, time, sequence, length, bytes of what is counted
 *   counts    of messages by channel, and of sequences but 0
 *
 * Little-endian, as the files are. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

enum { MESSAGE = 0x05, MESSAGE_INDEX = 0x07, HEAD = 31, INDEX_HEAD = 15, ENTRY = 16, STREAM_HEAD = 16 };

/* Of each message one, so many bytes after that of the message before. */
typedef struct {
    const unsigned char *at;
    ptrdiff_t stride;
} Column;

typedef struct {
    size_t n;
    const unsigned char *data;
    Column channel, sequence, time, start, stop;
} Part;

/* By number of the channel. */
typedef struct {
    size_t n;
    const int32_t *rank;
    const unsigned char *prefixes;
    const int64_t *prefix, *prefix_size; /* of what is not counted 0 */
} Channels;

typedef struct {
    uint64_t time, place; /* of the topic, then the sequence */
    const unsigned char *data;
    uint32_t size;
    uint16_t channel;
} Message;

/* Room for n messages, twice, and as many sequences; by channel for its place, for the count of its
 * messages, and for a place in `used`; and for what is made. */
typedef struct {
    Message *messages, *spare;
    uint32_t *sequences;
    uint64_t *cursors, *counts;
    uint16_t *used;
    unsigned char *records, *index, *offsets, *stream;
} Room;

typedef struct {
    size_t n_used, records_size, index_size, stream_size, ticks;
    uint64_t first, last; /* times */
} Made;

static unsigned char *put(unsigned char *into, const void *from, size_t size)
{
    memcpy(into, from, size);
    return into + size;
}

static void get(void *into, const Column *column, size_t row, size_t size)
{
    memcpy(into, column->at + (ptrdiff_t)row * column->stride, size);
}

static Message message(const Part *of, size_t row, const int32_t *rank)
{
    Message found;
    uint32_t sequence;
    int64_t start, stop;
    get(&found.time, &of->time, row, sizeof found.time);
    get(&found.channel, &of->channel, row, sizeof found.channel);
    get(&sequence, &of->sequence, row, sizeof sequence);
    get(&start, &of->start, row, sizeof start);
    get(&stop, &of->stop, row, sizeof stop);
    found.place = (uint64_t)rank[found.channel] << 32 | sequence;
    found.data = of->data + start;
    found.size = (uint32_t)(stop - start);
    return found;
}

static bool is_before(const Message *one, const Message *other)
{
    if (one->time != other->time)
        return one->time < other->time;
    if (one->place != other->place)
        return one->place < other->place;
    const size_t shorter = one->size < other->size ? one->size : other->size;
    const int by_bytes = memcmp(one->data, other->data, shorter);
    return by_bytes ? by_bytes < 0 : one->size < other->size;
}

/* Where the row of messages ends that are in order from `first` on. */
static size_t run_end(const Message *messages, size_t first, size_t n)
{
    for (size_t next = first + 1; next < n; ++next)
        if (is_before(&messages[next], &messages[next - 1]))
            return next;
    return n;
}

/* Merge neighbouring runs until there is one; messages come in a few. Return where it is. */
static const Message *sorted(Message *messages, Message *spare, size_t n)
{
    while (run_end(messages, 0, n) < n) {
        size_t at = 0;
        while (at < n) {
            const size_t middle = run_end(messages, at, n);
            const size_t end = middle < n ? run_end(messages, middle, n) : middle;
            size_t left = at, right = middle;
            for (; at < end; ++at) {
                const bool takes_right =
                    right < end &&
                    (left == middle || is_before(&messages[right], &messages[left]));
                spare[at] = messages[takes_right ? right++ : left++];
            }
        }
        Message *const merged = spare;
        spare = messages;
        messages = merged;
    }
    return messages;
}

static int by_number(const void *one, const void *other)
{
    const uint32_t a = *(const uint32_t *)one, b = *(const uint32_t *)other;
    return (a > b) - (a < b);
}

/* Of how many ticks messages are; nobody says that of two times the later is of the later one. */
static size_t ticks_of(const Message *messages, size_t n, uint32_t *sequences)
{
    size_t changes = 0, ticks = 0;
    for (size_t i = 0; i < n; ++i) {
        const uint32_t sequence = (uint32_t)messages[i].place;
        if (changes == 0 || sequences[changes - 1] != sequence)
            sequences[changes++] = sequence;
    }
    qsort(sequences, changes, sizeof *sequences, by_number);
    for (size_t i = 0; i < changes; ++i)
        ticks += sequences[i] != 0 && (i == 0 || sequences[i] != sequences[i - 1]);
    return ticks;
}

/* Write the head of each channel's index and where it begins, and let its cursor be after that. */
static void begin_indexes(const Room *room, Made *made)
{
    unsigned char *offsets = room->offsets;
    uint64_t begin = 0;
    for (size_t i = 0; i < made->n_used; ++i) {
        const uint16_t channel = room->used[i];
        const uint32_t size = (uint32_t)(ENTRY * room->counts[channel]);
        const uint64_t length = (uint64_t)size + 6;
        offsets = put(offsets, &channel, sizeof channel);
        offsets = put(offsets, &begin, sizeof begin);
        unsigned char *head = room->index + begin;
        *head++ = MESSAGE_INDEX;
        head = put(head, &length, sizeof length);
        head = put(head, &channel, sizeof channel);
        put(head, &size, sizeof size);
        room->cursors[channel] = begin + INDEX_HEAD;
        begin += INDEX_HEAD + size;
    }
    made->index_size = begin;
}

#define EXPORTED __attribute__((visibility("default")))

/* Take the messages of some parts; say how many bytes of records and of the stream they are. */
EXPORTED void gather(const Part *parts, size_t n_parts, const Channels *channels, const Room *room,
                     Made *made)
{
    Message *next = room->messages;
    made->records_size = made->stream_size = 0;
    for (const Part *part = parts; part < parts + n_parts; ++part)
        for (size_t row = 0; row < part->n; ++row) {
            *next = message(part, row, channels->rank);
            made->records_size += HEAD + next->size;
            const size_t prefix_size = (size_t)channels->prefix_size[next->channel];
            if (prefix_size)
                made->stream_size += prefix_size + STREAM_HEAD + next->size;
            ++next;
        }
}

/* Arrange the n messages, at least one, that were taken. */
EXPORTED void arrange(size_t n, const Channels *channels, const Room *room, Made *made)
{
    const Message *const messages = sorted(room->messages, room->spare, n);
    made->first = messages[0].time;
    made->last = messages[n - 1].time;
    made->ticks = ticks_of(messages, n, room->sequences);
    made->n_used = 0;
    memset(room->counts, 0, channels->n * sizeof *room->counts);
    for (size_t i = 0; i < n; ++i)
        if (room->counts[messages[i].channel]++ == 0)
            room->used[made->n_used++] = messages[i].channel;
    begin_indexes(room, made);
    unsigned char *record = room->records, *stream = room->stream;
    for (size_t i = 0; i < n; ++i) {
        const Message *const of = &messages[i];
        const uint32_t sequence = (uint32_t)of->place;
        const uint64_t length = HEAD - 9 + (uint64_t)of->size;
        const uint64_t at = (uint64_t)(record - room->records);
        uint64_t *const cursor = &room->cursors[of->channel];
        put(put(room->index + *cursor, &of->time, sizeof of->time), &at, sizeof at);
        *cursor += ENTRY;
        *record++ = MESSAGE;
        record = put(record, &length, sizeof length);
        record = put(record, &of->channel, sizeof of->channel);
        record = put(record, &sequence, sizeof sequence);
        record = put(record, &of->time, sizeof of->time);
        record = put(record, &of->time, sizeof of->time);
        record = put(record, of->data, of->size);
        const size_t prefix_size = (size_t)channels->prefix_size[of->channel];
        if (prefix_size == 0)
            continue;
        stream = put(stream, channels->prefixes + channels->prefix[of->channel], prefix_size);
        stream = put(stream, &of->time, sizeof of->time);
        stream = put(stream, &sequence, sizeof sequence);
        stream = put(stream, &of->size, sizeof of->size);
        stream = put(stream, of->data, of->size);
    }
}
