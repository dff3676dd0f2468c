"""The recorder hears everything and writes the very bytes that travelled, a closed tick at a time.

Tick k closes with the samples of t_k and the states of (t_{k−1}, t_k]; tick 0 holds the states of
t_0. All that must have travelled is counted, and whoever is missing is named.
"""

from collections.abc import Sequence

from bus.errors import BusError
from bus.keys import EVERYTHING, sample_key, state_key
from bus.messages import HEADER, SAMPLE, STATE
from bus.transport import Bus
from recordings.container import Channel, Schema
from recordings.writing import Writer


def channels(n: int) -> list[Channel]:
    """Return the channels of n robots and the target."""
    samples = [Channel(sample_key(node), SAMPLE.name) for node in range(n + 1)]
    return samples + [Channel(state_key(robot), STATE.name) for robot in range(1, n + 1)]


def schemas() -> list[Schema]:
    """Return the protobuf schemas of all messages."""
    return [Schema(kind.name, kind.descriptor()) for kind in (SAMPLE, STATE)]


class Recorder:
    """Writes what n robots and the target say on a bus."""

    def __init__(self, bus: Bus, writer: Writer, n: int) -> None:
        self._inbox = bus.listen(EVERYTHING)
        self._writer = writer
        self._samples = [sample_key(node) for node in range(n + 1)]
        self._states = [state_key(robot) for robot in range(1, n + 1)]
        self.messages = 0

    def close_tick(self, k: int, outputs: Sequence[int]) -> None:
        """Write tick k, whose states lie at the output times (ns); `BusError` if one is missing."""
        header = HEADER.unpack_from
        batch = []
        for key, data in self._inbox.take():
            _, sequence, time_ns = header(data)
            batch.append((time_ns, key, sequence, data))
        expected = len(self._states) * len(outputs) + (len(self._samples) if k else 0)
        if len(batch) != expected:
            raise BusError(self._who_is_missing(k, outputs, {(t, key) for t, key, *_ in batch}))
        self._writer.write(batch)
        self.messages += len(batch)

    def _who_is_missing(self, k: int, outputs: Sequence[int], got: set[tuple[int, str]]) -> str:
        wanted = {(t, key) for t in outputs for key in self._states}
        wanted |= {(outputs[-1], key) for key in self._samples if k}
        missing = [f"{key} at {t} ns" for t, key in sorted(wanted - got)[:10]]
        surplus = [f"{key} at {t} ns" for t, key in sorted(got - wanted)[:10]]
        return (
            f"tick {k} could not be recorded: missing {', '.join(missing) or 'nothing'}; "
            f"not expected {', '.join(surplus) or 'nothing that can be told apart'}"
        )
