/* What becomes of a chunk's messages, to the same bytes as NumPy makes of them, which is the oracle:
 *
 *   order     by (time, place of the topic, sequence), then by their bytes
 *   records   each after the 31 bytes that stand before it in a file
 *   index     of each channel, in the order of their first messages: (time, place of the record)
 *   stream    what the digest is over: topic, time, sequence, length, bytes of what is counted
 *
 * Little-endian, as the files are. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { MESSAGE = 0x05, MESSAGE_INDEX = 0x07, HEAD = 31, INDEX_HEAD = 15, ENTRY = 16 };

typedef struct {
    size_t n;
    const unsigned char *data;
    const uint16_t *channel;
    const uint32_t *sequence;
    const uint64_t *time;
    const int64_t *start, *stop;
} Messages;

/* By number of the channel. */
typedef struct {
    const int32_t *rank;
    const unsigned char *prefixes;
    const int64_t *prefix, *prefix_size; /* of what is not counted 0 */
    uint64_t *count, *cursor;            /* all 0 between two calls; any */
} Channels;

typedef struct {
    uint64_t time, place; /* of the topic and of the sequence */
    size_t row;
} Key;

/* Room for 2 n keys and n channels, and for what is made. */
typedef struct {
    Key *keys;
    uint16_t *used;
    unsigned char *records, *index, *offsets, *stream;
    size_t n_used, index_size, stream_size;
} Made;

static unsigned char *put(unsigned char *into, const void *from, size_t size)
{
    memcpy(into, from, size);
    return into + size;
}

static size_t size_of(const Messages *of, size_t row)
{
    return (size_t)(of->stop[row] - of->start[row]);
}

static bool is_before(const Messages *of, const Key *one, const Key *other)
{
    if (one->time != other->time)
        return one->time < other->time;
    if (one->place != other->place)
        return one->place < other->place;
    const size_t size = size_of(of, one->row), its = size_of(of, other->row);
    const int by_bytes = memcmp(of->data + of->start[one->row], of->data + of->start[other->row],
                                size < its ? size : its);
    return by_bytes ? by_bytes < 0 : size < its;
}

/* Where the row of keys ends that are in order from `first` on. */
static size_t run_end(const Messages *of, const Key *keys, size_t first)
{
    for (size_t next = first + 1; next < of->n; ++next)
        if (is_before(of, &keys[next], &keys[next - 1]))
            return next;
    return of->n;
}

/* Merge neighbouring runs until there is one; messages come in a few. Return where it is. */
static const Key *sorted(const Messages *of, Key *keys, Key *spare)
{
    while (run_end(of, keys, 0) < of->n) {
        size_t at = 0;
        while (at < of->n) {
            const size_t middle = run_end(of, keys, at);
            const size_t end = middle < of->n ? run_end(of, keys, middle) : middle;
            size_t left = at, right = middle;
            for (; at < end; ++at) {
                const bool takes_right =
                    right < end && (left == middle || is_before(of, &keys[right], &keys[left]));
                spare[at] = keys[takes_right ? right++ : left++];
            }
        }
        Key *const merged = spare;
        spare = keys;
        keys = merged;
    }
    return keys;
}

/* Write the head of each channel's index and where it begins, and let its cursor be after that. */
static void begin_indexes(const Channels *channels, Made *made)
{
    unsigned char *offsets = made->offsets;
    uint64_t begin = 0;
    for (size_t i = 0; i < made->n_used; ++i) {
        const uint16_t channel = made->used[i];
        const uint32_t size = (uint32_t)(ENTRY * channels->count[channel]);
        const uint64_t length = (uint64_t)size + 6;
        offsets = put(offsets, &channel, sizeof channel);
        offsets = put(offsets, &begin, sizeof begin);
        unsigned char *head = made->index + begin;
        *head++ = MESSAGE_INDEX;
        head = put(head, &length, sizeof length);
        head = put(head, &channel, sizeof channel);
        put(head, &size, sizeof size);
        channels->cursor[channel] = begin + INDEX_HEAD;
        channels->count[channel] = 0;
        begin += INDEX_HEAD + size;
    }
    made->index_size = begin;
}

__attribute__((visibility("default"))) void arrange(const Messages *of, const Channels *channels,
                                                    Made *made)
{
    for (size_t row = 0; row < of->n; ++row) {
        const uint64_t rank = (uint64_t)channels->rank[of->channel[row]];
        made->keys[row] = (Key){of->time[row], rank << 32 | of->sequence[row], row};
    }
    const Key *const keys = sorted(of, made->keys, made->keys + of->n);
    made->n_used = 0;
    for (size_t i = 0; i < of->n; ++i) {
        const uint16_t channel = of->channel[keys[i].row];
        if (channels->count[channel]++ == 0)
            made->used[made->n_used++] = channel;
    }
    begin_indexes(channels, made);
    unsigned char *record = made->records, *stream = made->stream;
    for (size_t i = 0; i < of->n; ++i) {
        const size_t row = keys[i].row, size = size_of(of, row);
        const unsigned char *const data = of->data + of->start[row];
        const uint16_t channel = of->channel[row];
        const uint32_t sequence = of->sequence[row], short_size = (uint32_t)size;
        const uint64_t time = of->time[row], length = HEAD - 9 + size;
        const uint64_t at = (uint64_t)(record - made->records);
        put(put(made->index + channels->cursor[channel], &time, sizeof time), &at, sizeof at);
        channels->cursor[channel] += ENTRY;
        *record++ = MESSAGE;
        record = put(record, &length, sizeof length);
        record = put(record, &channel, sizeof channel);
        record = put(record, &sequence, sizeof sequence);
        record = put(record, &time, sizeof time);
        record = put(record, &time, sizeof time);
        record = put(record, data, size);
        const size_t prefix_size = (size_t)channels->prefix_size[channel];
        if (!prefix_size)
            continue;
        stream = put(stream, channels->prefixes + channels->prefix[channel], prefix_size);
        stream = put(stream, &time, sizeof time);
        stream = put(stream, &sequence, sizeof sequence);
        stream = put(stream, &short_size, sizeof short_size);
        stream = put(stream, data, size);
    }
    made->stream_size = (size_t)(stream - made->stream);
}
