"""What comes over the wire is believed as it was put, or refused with the reason of its fault."""

import struct

import numpy as np
import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.bus.framing import joined
from nrs_cosim.bus.keys import RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.messages import CHECKPOINT, LINK_EVENT, STATE, Blob, Codec
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.validation import RejectedError, Tick, Wire

M, TICKS, K = 2, 5, 3
WORKER, ROBOTS = "left", [2, 4]
SIGNER = Signer(b"secret")
RNG = np.random.default_rng(182)


class TwoOutputs:
    """Sampling times 100 ns apart, with an output half way."""

    ticks = TICKS

    def t(self, k):
        return 100 * k

    def outputs(self, k):
        return [100 * k - 50, 100 * k] if k else [0]


def new_wire(signer=SIGNER, silent=lambda _k: np.empty(0, np.int64), **options):
    assignment = {WORKER: np.array(ROBOTS), "right": np.array([1, 3]), TARGET: np.array([0])}
    return Wire(Codecs.of(Sizes(M)), TwoOutputs(), assignment, signer, silent, **options)


def samples_of(wire, k=K, robots=ROBOTS):
    records = wire.samples.blank(np.array(robots))
    records["k"], records["time_ns"] = k, 100 * k
    for name in ("position", "velocity"):
        records[name] = RNG.normal(size=(len(robots), M))
    return records


def states_of(wire, k=K):
    outputs = wire.times.outputs(k)
    records = wire.states.blank(np.tile(ROBOTS, len(outputs)))
    records["k"], records["time_ns"] = k, np.repeat(outputs, len(ROBOTS))
    for name in STATE.fields:
        records[name] = RNG.normal(size=(len(records), M))
    return records


def faults_of(wire, robots=(4, 2)):
    records = wire.link_events.blank(np.array(robots))
    records["k"], records["time_ns"] = K, 100 * K
    records["source"], records["lost"] = 1, 1
    return records


def checkpoints_of(robots=ROBOTS, k=K, time_ns=100 * K):
    return [CHECKPOINT.encode(Blob(robot, k, time_ns, b"state")) for robot in robots]


def signed(kind, body, k=K, worker=WORKER, signer=SIGNER):
    return signer.sign(wire_key(kind, worker), struct.pack("<I", k) + body)


def test_samples_unpack_to_what_was_packed():
    wire, records = new_wire(), samples_of(new_wire())
    payload = wire.pack_samples(WORKER, K, records)
    assert payload == signed(SAMPLES, records.tobytes())
    for _ in range(2):  # the same bytes again, which are judged once
        k, accepted = wire.unpack_samples(WORKER, payload)
        assert (k, accepted.tobytes()) == (K, records.tobytes())
    later = wire.pack_samples(WORKER, K + 1, samples_of(wire, K + 1))
    assert wire.unpack_samples(WORKER, later)[0] == K + 1


def test_no_samples_are_expected_of_silent_robots():
    wire = new_wire(silent=lambda k: np.array([4] if k == K else []))
    for k, robots in ((K, [2]), (K + 1, ROBOTS)):
        payload = wire.pack_samples(WORKER, k, samples_of(wire, k, robots))
        assert wire.unpack_samples(WORKER, payload)[1]["robot"].tolist() == robots


@pytest.mark.parametrize("k", [0, 1, K, TICKS])
def test_a_tick_unpacks_to_what_was_packed(k):
    wire = new_wire()
    result = Tick(states_of(wire, k), wire.none, checkpoints_of(k=k, time_ns=100 * k))
    got_k, got = wire.unpack_tick(WORKER, wire.pack_tick(WORKER, k, result))
    assert got_k == k
    assert got.states.tobytes() == result.states.tobytes()
    assert len(got.link_events) == 0
    assert got.checkpoints == result.checkpoints


def test_link_events_unpack_to_what_was_packed_and_checkpoints_may_be_missing():
    wire = new_wire()
    result = Tick(states_of(wire), faults_of(wire), ())
    _, got = wire.unpack_tick(WORKER, wire.pack_tick(WORKER, K, result))
    assert got.link_events.tobytes() == result.link_events.tobytes()
    assert list(got.checkpoints) == []


def changed(records, name, value, row=0):
    """Return records of which one has another value."""
    records = records.copy()
    records[name][row] = value
    return records


WIRE = new_wire()
STATES, LINK_EVENTS, CHECKPOINTS = states_of(WIRE), faults_of(WIRE), checkpoints_of()
GOOD_SAMPLES = samples_of(WIRE)

MISSED = {
    "an unknown worker": ("worker", "nobody", signed(SAMPLES, b"", worker="nobody")),
    "the signature of another key": ("signature", WORKER, signed(RECORDS, GOOD_SAMPLES.tobytes())),
    "another secret": (
        "signature",
        WORKER,
        signed(SAMPLES, GOOD_SAMPLES.tobytes(), signer=Signer(b"other")),
    ),
    "nothing": ("signature", WORKER, b""),
    "no whole k": ("size", WORKER, SIGNER.sign(wire_key(SAMPLES, WORKER), b"\0\0\0")),
    "the tick before the first": ("tick", WORKER, signed(SAMPLES, b"", k=0)),
    "a tick after the last": ("tick", WORKER, signed(SAMPLES, b"", k=TICKS + 1)),
    "a byte too few": ("size", WORKER, signed(SAMPLES, GOOD_SAMPLES.tobytes()[:-1])),
    "a byte too many": ("size", WORKER, signed(SAMPLES, GOOD_SAMPLES.tobytes() + b"\0")),
    "one robot alone": ("size", WORKER, signed(SAMPLES, GOOD_SAMPLES[:1].tobytes())),
    "another robot": (
        "robot",
        WORKER,
        signed(SAMPLES, changed(GOOD_SAMPLES, "robot", 3).tobytes()),
    ),
    "another tick": ("tick", WORKER, signed(SAMPLES, changed(GOOD_SAMPLES, "k", 2, 1).tobytes())),
    "another time": (
        "time",
        WORKER,
        signed(SAMPLES, changed(GOOD_SAMPLES, "time_ns", 301).tobytes()),
    ),
    "another tag": ("form", WORKER, signed(SAMPLES, changed(GOOD_SAMPLES, "k.tag", 9).tobytes())),
    **{
        f"{name} of {number}": (
            "value",
            WORKER,
            signed(SAMPLES, changed(GOOD_SAMPLES, name, [0.5, number], 1).tobytes()),
        )
        for name in ("position", "velocity")
        for number in (np.nan, np.inf, -np.inf)
    },
}


@pytest.mark.parametrize("situation", MISSED)
def test_samples_are_refused_with_the_reason(situation):
    reason, worker, payload = MISSED[situation]
    with pytest.raises(RejectedError, match=f"^{reason}$"):
        new_wire().unpack_samples(worker, payload)


def test_large_finite_numbers_with_an_infinite_sum_are_accepted():
    wire = new_wire()
    records = changed(GOOD_SAMPLES, "position", [1.7e308, 1.7e308])
    with np.errstate(over="ignore"):  # as in a run
        _, accepted = wire.unpack_samples(WORKER, wire.pack_samples(WORKER, K, records))
    assert accepted.tobytes() == records.tobytes()


def test_samples_that_were_refused_are_refused_again():
    wire = new_wire()
    assert wire.unpack_samples(WORKER, wire.pack_samples(WORKER, K, GOOD_SAMPLES))
    for _ in range(2):
        with pytest.raises(RejectedError, match=r"^robot$"):
            wire.unpack_samples(*MISSED["another robot"][1:])


def tick_of(states=STATES, met=b"", checkpoints=(), k=K):
    states = states if isinstance(states, bytes) else states.tobytes()
    met = met if isinstance(met, bytes) else met.tobytes()
    return signed(RECORDS, joined([states, met, *checkpoints]), k=k)


TICKS_REJECTED = {
    "an unknown worker": ("worker", "nobody", tick_of()),
    "the signature of another key": (
        "signature",
        WORKER,
        signed(SAMPLES, joined([STATES.tobytes(), b""])),
    ),
    "no whole k": ("size", WORKER, SIGNER.sign(wire_key(RECORDS, WORKER), b"\0\0")),
    "a tick after the last": ("tick", WORKER, tick_of(k=TICKS + 1)),
    "parts that are cut": ("size", WORKER, signed(RECORDS, joined([STATES.tobytes(), b""])[:-1])),
    "states alone": ("size", WORKER, signed(RECORDS, joined([STATES.tobytes()]))),
    "no part": ("size", WORKER, signed(RECORDS, b"")),
    "the states of one output": ("size", WORKER, tick_of(STATES[:2])),
    "states of another robot": ("robot", WORKER, tick_of(changed(STATES, "robot", 3, 3))),
    "states of another tick": ("tick", WORKER, tick_of(changed(STATES, "k", 2, 3))),
    "states of another time": ("time", WORKER, tick_of(changed(STATES, "time_ns", 300, 0))),
    "states of another form": ("form", WORKER, tick_of(changed(STATES, "effort.tag", 9, 3))),
    "a torque that is no number": (
        "value",
        WORKER,
        tick_of(changed(STATES, "effort", [0.0, np.nan], 3)),
    ),
    "a fault that is cut": ("size", WORKER, tick_of(met=LINK_EVENTS.tobytes()[:-1])),
    "a fault that is no number": (
        "value",
        WORKER,
        tick_of(met=changed(LINK_EVENTS, "position", [np.nan, 0.0], 1)),
    ),
    "a fault of another form": (
        "value",
        WORKER,
        tick_of(met=changed(LINK_EVENTS, "lost.tag", 9, 1)),
    ),
    "a fault of another tick": ("tick", WORKER, tick_of(met=changed(LINK_EVENTS, "k", 2, 1))),
    "a fault of another worker's robot": (
        "robot",
        WORKER,
        tick_of(met=changed(LINK_EVENTS, "robot", 3)),
    ),
    "a checkpoint that is cut": (
        "size",
        WORKER,
        tick_of(checkpoints=[CHECKPOINTS[0], CHECKPOINTS[1][:10]]),
    ),
    "a checkpoint too few": ("robot", WORKER, tick_of(checkpoints=CHECKPOINTS[:1])),
    "checkpoints in another order": ("robot", WORKER, tick_of(checkpoints=CHECKPOINTS[::-1])),
    "a checkpoint of another tick": (
        "tick",
        WORKER,
        tick_of(checkpoints=[CHECKPOINTS[0], *checkpoints_of([4], k=2)]),
    ),
    "a checkpoint of another time": (
        "tick",
        WORKER,
        tick_of(checkpoints=[*checkpoints_of([2], time_ns=299), CHECKPOINTS[1]]),
    ),
}


@pytest.mark.parametrize("situation", TICKS_REJECTED)
def test_a_tick_is_refused_with_the_reason(situation):
    reason, worker, payload = TICKS_REJECTED[situation]
    with pytest.raises(RejectedError, match=f"^{reason}$"):
        new_wire().unpack_tick(worker, payload)


def test_the_largest_batch_is_that_of_the_first_or_of_a_later_tick():
    """The grid has one output at t_0 and two in each interval; states of both are believed."""
    wire = new_wire()
    for k in (1, 0, K):
        result = Tick(states_of(wire, k), wire.none, ())
        assert wire.unpack_tick(WORKER, wire.pack_tick(WORKER, k, result))[0] == k


def test_without_a_secret_batches_are_unsigned():
    wire = new_wire(Signer())
    payload = wire.pack_samples(WORKER, K, GOOD_SAMPLES)
    assert payload == struct.pack("<I", K) + GOOD_SAMPLES.tobytes()
    assert wire.unpack_samples(WORKER, payload)[0] == K


def test_the_codec_of_faults_is_the_wires():
    assert WIRE.none.dtype == Codec(LINK_EVENT, Sizes(M)).dtype


KEPT = Codecs.of(
    Sizes(M), "Mine", kept={**ESTIMATE, "P": Field((2, "m")), "next": Field(())}, measured=True
)
PINNED = ROBOTS[-1:]
"""Of an odd tick; nobody is at an even one."""


def kept_wire():
    assignment = {WORKER: np.array(ROBOTS), TARGET: np.array([0])}
    return Wire(
        KEPT, TwoOutputs(), assignment, SIGNER, measuring=lambda k: np.array(PINNED[: k % 2], int)
    )


def kept_of(k=K, robots=ROBOTS):
    records = KEPT.of_agents["agent_state"].blank(np.array(robots))
    records["k"], records["time_ns"] = k, 100 * k
    records["P"], records["next"] = RNG.normal(size=(len(robots), 2, M)), 7.5
    return records


def measured_of(robots, k=K):
    records = KEPT.of_agents["measurement"].blank(np.array(robots))
    records["k"], records["time_ns"], records["position"] = k, 100 * k, 3.0
    return records


def of_agents(kept=None, measured=None):
    parts = {"agent_state": kept, "measurement": measured}
    return {kind: records for kind, records in parts.items() if records is not None}


@pytest.mark.parametrize("k", [1, K, TICKS])
def test_what_agents_tell_unpacks_to_what_was_packed(k):
    wire = kept_wire()
    checkpoints = checkpoints_of(k=k, time_ns=100 * k)
    kept, measured = kept_of(k), measured_of(PINNED[: k % 2], k)
    result = Tick(states_of(wire, k), wire.none, checkpoints, of_agents(kept, measured))
    _, got = wire.unpack_tick(WORKER, wire.pack_tick(WORKER, k, result))
    assert got.of_agents["agent_state"].tobytes() == kept.tobytes()
    assert got.of_agents["measurement"].tobytes() == measured.tobytes()
    assert got.states.tobytes() == result.states.tobytes()
    assert list(got.checkpoints) == checkpoints


def test_nothing_is_kept_of_the_beginning():
    wire = kept_wire()
    result = Tick(states_of(wire, 0), wire.none, ())
    _, got = wire.unpack_tick(WORKER, wire.pack_tick(WORKER, 0, result))
    assert [len(records) for records in got.of_agents.values()] == [0, 0]


MEASURED = measured_of(PINNED)
WRONGLY_TOLD = {
    "none": ("size", K, None, MEASURED),
    "of one robot alone": ("size", K, kept_of()[:1], MEASURED),
    "of another robot": ("robot", K, changed(kept_of(), "robot", 3), MEASURED),
    "of another tick": ("tick", K, changed(kept_of(), "k", 2, 1), MEASURED),
    "of another time": ("time", K, changed(kept_of(), "time_ns", 301), MEASURED),
    "a number that is none": ("value", K, changed(kept_of(), "next", np.nan), MEASURED),
    "of another form": ("form", K, changed(kept_of(), "P.tag", 9), MEASURED),
    "of the beginning": ("size", 0, kept_of(0), None),
    "nothing measured": ("size", K, kept_of(), None),
    "measured by one that is not pinned": ("robot", K, kept_of(), measured_of(ROBOTS[:1])),
    "measured by more": ("size", K, kept_of(), measured_of(ROBOTS)),
    "measured when nobody is pinned": ("size", K + 1, kept_of(K + 1), measured_of(PINNED, K + 1)),
    "measured at the beginning": ("size", 0, None, measured_of(PINNED, 0)),
}


@pytest.mark.parametrize(("why", "k", "kept", "measured"), WRONGLY_TOLD.values(), ids=WRONGLY_TOLD)
def test_what_agents_cannot_tell_is_rejected(why, k, kept, measured):
    wire = kept_wire()
    tick = Tick(states_of(wire, k), wire.none, (), of_agents(kept, measured))
    payload = wire.pack_tick(WORKER, k, tick)
    with pytest.raises(RejectedError, match=f"^{why}$"):
        wire.unpack_tick(WORKER, payload)


def test_a_tick_without_the_part_of_agent_states_is_rejected():
    payload = signed(RECORDS, joined([states_of(kept_wire()).tobytes(), b""]))
    with pytest.raises(RejectedError, match=r"^size$"):
        kept_wire().unpack_tick(WORKER, payload)


class TestRobotsThatDecideWhenTheySend:
    @pytest.mark.parametrize("robots", [[], [2], [4], [2, 4]])
    def test_a_batch_may_hold_any_of_its_workers_robots(self, robots):
        wire = new_wire(triggered=True)
        records = samples_of(wire, robots=robots)
        k, accepted = wire.unpack_samples(WORKER, wire.pack_samples(WORKER, K, records))
        assert (k, accepted.tobytes()) == (K, records.tobytes())

    @pytest.mark.parametrize("robots", [[4, 2], [2, 2], [1], [2, 3], [5], [0, 2], [2, 4, 4]])
    def test_no_others_and_none_twice_or_out_of_order(self, robots):
        wire = new_wire(triggered=True)
        payload = wire.pack_samples(WORKER, K, samples_of(wire, robots=robots))
        with pytest.raises(RejectedError, match=r"^robot$"):
            wire.unpack_samples(WORKER, payload)

    def test_a_silence_cannot_be_forged(self):
        wire = new_wire(triggered=True)
        payload = wire.pack_samples(WORKER, K, samples_of(wire))
        with pytest.raises(RejectedError, match=r"^signature$"):
            wire.unpack_samples(WORKER, payload[: -wire.samples.size])

    def test_a_robot_in_an_outage_is_none_that_sends(self):
        wire = new_wire(silent=lambda _k: np.array([4]), triggered=True)
        for robots, accepted in (([2], True), ([], True), ([2, 4], False)):
            payload = wire.pack_samples(WORKER, K, samples_of(wire, robots=robots))
            if accepted:
                assert wire.unpack_samples(WORKER, payload)[1]["robot"].tolist() == robots
            else:
                with pytest.raises(RejectedError, match=r"^robot$"):
                    wire.unpack_samples(WORKER, payload)

    @pytest.mark.parametrize(
        ("change", "why"),
        [
            (lambda records: records.__setitem__("k", K + 1), "tick"),
            (lambda records: records.__setitem__("time_ns", 1), "time"),
            (lambda records: records.__setitem__("position", np.nan), "value"),
        ],
    )
    def test_what_is_sent_is_looked_at_as_ever(self, change, why):
        wire = new_wire(triggered=True)
        records = samples_of(wire, robots=[4])
        change(records)
        with pytest.raises(RejectedError, match=rf"^{why}$"):
            wire.unpack_samples(WORKER, wire.pack_samples(WORKER, K, records))

    def test_a_batch_that_is_cut_is_refused(self):
        wire = new_wire(triggered=True)
        data = samples_of(wire, robots=[2])
        payload = SIGNER.sign(wire_key(SAMPLES, WORKER), struct.pack("<I", K) + data.tobytes()[:-1])
        with pytest.raises(RejectedError, match=r"^size$"):
            wire.unpack_samples(WORKER, payload)

    def test_the_target_always_sends(self):
        wire = new_wire(triggered=True)
        payload = wire.pack_samples(TARGET, K, samples_of(wire, robots=[]))
        with pytest.raises(RejectedError, match=r"^size$"):
            wire.unpack_samples(TARGET, payload)


def in_one_process(**options):
    return new_wire(Signer(), in_process=True, **options)


def test_in_one_process_own_batches_come_back_as_what_was_packed():
    wire = in_one_process()
    samples, tick = samples_of(wire), Tick(states_of(wire), wire.none, ())
    for _ in range(2):
        k, received = wire.unpack_samples(WORKER, bytes(wire.pack_samples(WORKER, K, samples)))
        assert k == K
        assert received.tobytes() == samples.tobytes()
        payload = wire.pack_tick(WORKER, K, tick)
        assert wire.unpack_tick(WORKER, payload) == (K, tick)


def test_in_one_process_what_others_put_is_judged_all_the_same():
    wire, other = in_one_process(), new_wire(Signer())
    wire.pack_samples(WORKER, K, samples_of(wire))
    wire.pack_tick(WORKER, K, Tick(states_of(wire), wire.none, ()))
    wrong = samples_of(wire, k=K)
    wrong["robot"] = 3
    with pytest.raises(RejectedError, match="robot"):
        wire.unpack_samples(WORKER, other.pack_samples(WORKER, K, wrong))
    late = states_of(wire)
    late["time_ns"] += 1
    with pytest.raises(RejectedError, match="time"):
        wire.unpack_tick(WORKER, other.pack_tick(WORKER, K, Tick(late, wire.none, ())))


def test_in_one_process_own_batches_are_refused_for_their_numbers_and_for_the_silent():
    wire = in_one_process(silent=lambda k: np.array(ROBOTS[:1] if k == K + 1 else [], np.int64))
    infinite = samples_of(wire)
    infinite["velocity"][0, 0] = np.inf
    with pytest.raises(RejectedError, match="value"):
        wire.unpack_samples(WORKER, wire.pack_samples(WORKER, K, infinite))
    with pytest.raises(RejectedError, match="size"):
        wire.unpack_samples(WORKER, wire.pack_samples(WORKER, K + 1, samples_of(wire, K + 1)))


def target_samples(wire, ticks):
    """Return the target's samples of some ticks, one after another."""
    return np.concatenate([samples_of(wire, k, robots=[0]) for k in ticks])


def each(wire, payloads):
    """Return the target's samples as they are accepted, by tick."""
    accepted = [pair for payload in payloads for pair in wire.unpack_each(TARGET, payload)]
    return [(k, records.tobytes()) for k, records in accepted]


def test_in_one_process_the_targets_samples_of_some_ticks_are_one_batch():
    wire, other = in_one_process(), new_wire(Signer())
    records = target_samples(wire, range(1, TICKS))
    (payload,) = wire.pack_ahead(TARGET, records)
    expected = [(k, records[k - 1].tobytes()) for k in range(1, TICKS)]
    assert (
        each(wire, [bytes(payload)]) == each(other, other.pack_ahead(TARGET, records)) == expected
    )
    assert wire.own_samples(TARGET, payload).tobytes() == records.tobytes()
    moved = payload[:-1] + bytes([payload[-1] ^ 1])
    for strange in (moved, payload[:-1], other.pack_ahead(TARGET, records)[0]):
        assert wire.own_samples(TARGET, strange) is None
    for strange in (moved, payload[:-1]):
        with pytest.raises(RejectedError, match="size"):
            wire.unpack_each(TARGET, strange)


def test_in_one_process_the_targets_samples_travel_one_by_one_where_one_may_be_refused():
    wire = in_one_process(silent=lambda k: np.array([0] if k == 2 else [], np.int64))
    records = target_samples(wire, (1, 2, 3))
    first, refused, last = wire.pack_ahead(TARGET, records)
    assert [k for k, _ in each(wire, [first, last])] == [1, 3]
    with pytest.raises(RejectedError, match="size"):
        wire.unpack_each(TARGET, refused)
    wire = in_one_process()
    records["velocity"][1, 0] = np.nan
    first, refused, last = wire.pack_ahead(TARGET, records)
    assert [k for k, _ in each(wire, [first, last])] == [1, 3]
    with pytest.raises(RejectedError, match="value"):
        wire.unpack_each(TARGET, refused)
