"""Where each microsecond of a robot-interval goes: the parts of the ticks of a real run, timed.

Each part is some functions, by name, which are wrapped while the run lasts. A part has the
processor time of the calls to its functions, less that of the parts which they call; what no part
has is told as the rest, so that nothing is left out. It is the time that a thread had of a
processor: neither waiting nor a busy machine is in it, and threads that run side by side add up.

Beside the parts stands the floor: what the same ticks would take if there were nothing but the
FMUs' own arithmetic, one copy of the bytes, their digest, their compression, and the file.
"""

import time
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import local
from typing import Any

from benchmarks.work import scenario
from orchestrator.runs.running import run

PARTS: Mapping[str, Sequence[str]] = {
    "FMUs: references": ["plant_fmu.fleet:Fleet.hold"],
    "FMUs: step and get": ["plant_fmu.drives.stepped:Stepped.step"],
    "FMUs: states gathered": ["plant_fmu.fleet:Fleet.advance"],
    "agents: hear and jump": [
        "estimator_agents.agents:Agents.hear",
        "estimator_agents.agents:Agents.jump",
    ],
    "host: bounds looked at": ["orchestrator.runs.host:Host._expect_bounded"],
    "host: states as records": ["orchestrator.runs.host:Host._states"],
    "host: samples as records": ["orchestrator.runs.host:Host.publish_samples"],
    "host: waits and hears": ["orchestrator.runs.host:Host.hear"],
    "wire: batches packed": ["bus.wire:Wire.pack_samples", "bus.wire:Wire.pack_tick"],
    "wire: sealed and opened": ["bus.seal:Seal.closed", "bus.seal:Seal.opened"],
    "wire: batches vetted": ["bus.wire:Wire.unpack_samples", "bus.wire:Wire.unpack_tick"],
    "Zenoh: put": ["bus.network.zenoh_bus:ZenohBus.publisher()"],
    "Zenoh: taken": ["bus.network.zenoh_bus:ZenohInbox.take"],
    "recorder: takes": ["recordings.recorder:Recorder.take"],
    "recorder: messages made": ["recordings.recorder:Recorder.close"],
    "writer: tick sorted": ["recordings.writing:Writer.write"],
    "writer: chunk packed": ["recordings.writing:packed"],
    "writer: chunk digested": ["recordings.digest:Digest.update"],
    "writer: chunk indexed": ["recordings.writing:closed"],
    "writer: chunk compressed": ["recordings.chunk:_COMPRESS[zstd]"],
    "writer: CRCs": ["recordings.chunk:zlib.crc32"],
    "writer: file": ["recordings.writing:Writer._emit"],
}
"""The functions of each part, as module:name; [key] is an item of a dict, () what it returns."""


class Clockwork:
    """Times the calls to wrapped functions, each less the wrapped ones that it calls."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        self._thread = local()

    def wrap(self, part: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function as it was, timed for a part."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            inner = self._thread.__dict__.setdefault("inner", [0.0])
            inner.append(0.0)
            began = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.thread_time() - began
                self.seconds[part] += took - inner.pop()
                inner[-1] += took

        return timed

    @contextmanager
    def timing(self, parts: Mapping[str, Sequence[str]]) -> Iterator[None]:
        """Wrap the functions of some parts in the meantime; LookupError where one is not there."""
        undo: list[Callable[[], None]] = []
        try:
            for part, names in parts.items():
                undo += [self._put(part, name) for name in names]
            yield
        finally:
            for back in reversed(undo):
                back()

    def _put(self, part: str, name: str) -> Callable[[], None]:
        """Wrap a function where it is found; return how to put it back."""
        module, _, path = name.partition(":")
        *through, last = path.removesuffix("()").replace("[", ".[").split(".")
        owner: Any = import_module(module)
        for step in through:
            owner = getattr(owner, step)
        if last.startswith("["):
            key = last.strip("[]")
            was = owner[key]
            owner[key] = self.wrap(part, was)
            return lambda: owner.__setitem__(key, was)
        was = getattr(owner, last, None)
        if was is None:
            raise LookupError(f"{name} is not there any more; say in PARTS what does its work now")
        new = self.wrap(part, was)
        if name.endswith("()"):
            new = lambda *args, **kwargs: self.wrap(part, was(*args, **kwargs))  # noqa: E731
        setattr(owner, last, new)
        return lambda: setattr(owner, last, was)


def parts_of(n: int, ticks: int) -> dict[str, float]:
    """Return the microseconds of a robot-interval that each part has, and the rest."""
    clockwork = Clockwork()
    at: list[tuple[int, float, Counter[str]]] = []

    def watch(time_ns: int) -> None:
        at.append((time_ns, time.process_time(), clockwork.seconds.copy()))

    with TemporaryDirectory(prefix="nrs-") as folder, clockwork.timing(PARTS):
        outcome = run(scenario(n, ticks), Path(folder) / "anatomy.mcap", watch=watch)
    assert outcome.status == "completed", outcome.reason
    first = at[1]
    last = at[-1]
    us = 1e6 / (n * (ticks - 1))
    found = {part: (last[2][part] - first[2][part]) * us for part in PARTS}
    whole = (last[1] - first[1]) * us
    return {**found, "the rest": whole - sum(found.values()), "all": whole}


def main() -> None:
    """Print the table."""
    parser = ArgumentParser()
    parser.add_argument("--robots", type=int, nargs="+", default=[100, 1000])
    parser.add_argument("--intervals", type=int, default=100_000)
    parser.add_argument("--rounds", type=int, default=5)
    told = parser.parse_args()
    columns = []
    for n in told.robots:
        rounds = [parts_of(n, max(told.intervals // n, 10)) for _ in range(told.rounds)]
        columns.append(min(rounds, key=lambda found: found["all"]))
    print(f"us of processor time a robot-interval; the least of {told.rounds} runs")
    print(f"{'robots':28}" + "".join(f"{n:>9}" for n in told.robots))
    for part in columns[0]:
        print(f"{part:28}" + "".join(f"{found[part]:>9.3f}" for found in columns))


if __name__ == "__main__":
    main()
