"""The recorder hears everything and writes the very bytes that travelled, a closed tick at a time.

Tick k closes with the samples of t_k and the states of (t_{k−1}, t_k]; tick 0 holds the states of
t_0. All that must have travelled is counted, and whoever is missing is named. What befell samples
on their way is written beside them, and does not enter the digest.
"""

from collections.abc import Collection, Sequence

from bus.errors import BusError
from bus.keys import EVERYTHING, fault_key, sample_key, state_key
from bus.messages import FAULT, HEADER, SAMPLE, STATE
from bus.transport import Bus
from recordings.container import Channel, Schema
from recordings.writing import Writer


def channels(n: int, faulty: Collection[int] = ()) -> list[Channel]:
    """Return the channels of n robots and the target; those of faults are the faulty robots'."""
    samples = [Channel(sample_key(node), SAMPLE.name) for node in range(n + 1)]
    states = [Channel(state_key(robot), STATE.name) for robot in range(1, n + 1)]
    return samples + states + [Channel(fault_key(i), FAULT.name, counted=False) for i in faulty]


def schemas(faulty: Collection[int] = ()) -> list[Schema]:
    """Return the protobuf schemas of all messages."""
    kinds = (SAMPLE, STATE, FAULT) if faulty else (SAMPLE, STATE)
    return [Schema(kind.name, kind.descriptor()) for kind in kinds]


class Recorder:
    """Writes what n robots and the target say on a bus."""

    def __init__(self, bus: Bus, writer: Writer, n: int, faulty: Collection[int] = ()) -> None:
        self._inbox = bus.listen(EVERYTHING)
        self._writer = writer
        self._samples = [sample_key(node) for node in range(n + 1)]
        self._states = [state_key(robot) for robot in range(1, n + 1)]
        self._faults = {fault_key(robot) for robot in faulty}
        self.messages = 0

    def close_tick(self, k: int, outputs: Sequence[int], silent: Collection[int] = ()) -> None:
        """Write tick k, whose states lie at the output times (ns); the silent send no sample.

        Raises `BusError` if a message is missing, or is there without being expected.
        """
        header = HEADER.unpack_from
        batch = []
        for key, data in self._inbox.take():
            _, sequence, time_ns = header(data)
            batch.append((time_ns, key, sequence, data))
        expected = len(self._states) * len(outputs)
        expected += len(self._samples) - len(silent) if k else 0
        faults = sum(key in self._faults for _, key, *_ in batch) if self._faults else 0
        if len(batch) - faults != expected:
            got = {(t, key) for t, key, *_ in batch if key not in self._faults}
            raise BusError(self._who_is_missing(k, outputs, silent, got))
        self._writer.write(batch)
        self.messages += len(batch)

    def _who_is_missing(
        self, k: int, outputs: Sequence[int], silent: Collection[int], got: set[tuple[int, str]]
    ) -> str:
        wanted = {(t, key) for t in outputs for key in self._states}
        wanted |= {(outputs[-1], key) for key in self._samples if k}
        wanted -= {(outputs[-1], sample_key(robot)) for robot in silent}
        missing = [f"{key} at {t} ns" for t, key in sorted(wanted - got)[:10]]
        surplus = [f"{key} at {t} ns" for t, key in sorted(got - wanted)[:10]]
        return (
            f"tick {k} could not be recorded: missing {', '.join(missing) or 'nothing'}; "
            f"not expected {', '.join(surplus) or 'nothing that can be told apart'}"
        )
