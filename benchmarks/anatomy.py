"""Where each microsecond of a robot-interval goes: the parts of the ticks of a real run, timed.

Each part is some functions, by name, which are wrapped while the run lasts. A part has the
processor time of the calls to its functions, less that of the parts which they call; what no part
has is told as the rest, so that nothing is left out. It is the time that a thread had of a
processor: neither waiting nor a busy machine is in it. What the writer does in a thread of its own
goes on beside the ticks, where a processor is free.

It is counted from the end of tick 1 to the end of the file. Beside the parts stands the floor: see
`benchmarks.floor`.
"""

import time
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import current_thread, local, main_thread
from typing import Any

from benchmarks.floor import floor
from benchmarks.table import keep, machine, text
from benchmarks.work import scenario
from nrs_cosim.orchestrator.engine.run import run

PARTS: Mapping[str, Sequence[str]] = {
    "tick: FMUs, states, records": [
        "nrs_cosim.orchestrator.engine.native.whole_tick:WholeTick.advance"
    ],
    "tick: receive and jump": [
        "nrs_cosim.orchestrator.engine.native.whole_tick:WholeTick.jump",
    ],
    "block: what was received": ["nrs_cosim.orchestrator.engine.blocks:Blocks._received"],
    "block: all else": ["nrs_cosim.orchestrator.engine.blocks:Blocks.run"],
    "target: its samples": ["nrs_cosim.orchestrator.engine.lockstep:TargetNode.publish_until"],
    "wire: batches packed": [
        "nrs_cosim.bus.validation:Wire.pack_ahead",
        "nrs_cosim.bus.validation:Wire.pack_block",
    ],
    "Zenoh: put": ["nrs_cosim.bus.network.zenoh_bus:ZenohBus.publisher()"],
    "Zenoh: taken": ["nrs_cosim.bus.network.zenoh_bus:ZenohInbox.take"],
    "recorder: batches taken": ["nrs_cosim.recordings.recorder:Recorder.take"],
    "recorder: tick closed": ["nrs_cosim.recordings.recorder:Recorder.close"],
    "writer: tick taken": ["nrs_cosim.recordings.mcap.writer:Writer.put"],
    "writer: chunk arranged": ["nrs_cosim.recordings.mcap.native.arrangement:_arrange_by()"],
    "writer: digest": ["nrs_cosim.recordings.mcap.digest:Digest.take"],
    "writer: compression": ["nrs_cosim.recordings.mcap.chunk:_COMPRESS[zstd]"],
    "writer: CRCs": ["nrs_cosim.recordings.mcap.chunk:zlib.crc32"],
    "writer: chunk joined": ["nrs_cosim.recordings.mcap.writer:encoded_chunk"],
    "writer: file": ["nrs_cosim.recordings.mcap.writer:Writer._emit"],
    "writer: end of the file": ["nrs_cosim.recordings.mcap.writer:Writer.finish"],
}
"""The functions of each part, as module:name; [key] is an item of a dict, () what it returns."""
LAST = "nrs_cosim.recordings.mcap.writer:Writer.finish"
REST, BESIDE, ALL = "the rest", "of all, in the writer's thread", "all"

Function = Callable[..., Any]


class Clockwork:
    """Times the calls to wrapped functions, each less the wrapped ones that it calls."""

    def __init__(self) -> None:
        self.seconds: Counter[str] = Counter()
        """By part, and under `BESIDE` what is not in the main thread."""
        self._thread = local()

    def timed(self, part: str, function: Function) -> Function:
        """Return a function as it was, timed for a part."""

        def wrapper(*args: Any, **kwargs: Any) -> Any:
            inner = self._thread.__dict__.setdefault("inner", [0.0])
            inner.append(0.0)
            began = time.thread_time()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.thread_time() - began
                own = took - inner.pop()
                inner[-1] += took
                self.seconds[part] += own
                if current_thread() is not main_thread():
                    self.seconds[BESIDE] += own

        return wrapper

    @contextmanager
    def timing(self, parts: Mapping[str, Sequence[str]]) -> Iterator[None]:
        """Time the functions of some parts in the meantime; LookupError where one is not there."""
        undo: list[Callable[[], None]] = []
        try:
            for part, names in parts.items():
                undo.extend(replaced(name, partial(self.timed, part)) for name in names)
            yield
        finally:
            for back in reversed(undo):
                back()


def replaced(name: str, by: Callable[[Function], Function]) -> Callable[[], None]:
    """Put what is made of a function in its place; return how to put it back."""
    module, _, path = name.partition(":")
    *through, last = path.removesuffix("()").replace("[", ".[").split(".")
    owner: Any = import_module(module)
    for step in through:
        owner = getattr(owner, step)
    if last.startswith("["):
        key, items = last.strip("[]"), owner
        was = items[key]
        items[key] = by(was)
        return lambda: items.__setitem__(key, was)
    was = getattr(owner, last, None)
    if was is None:
        raise LookupError(f"{name} is not there any more; say in PARTS what does its work now")
    setattr(owner, last, _maker(was, by) if name.endswith("()") else by(was))
    return lambda: setattr(owner, last, was)


def _maker(make: Function, by: Callable[[Function], Function]) -> Function:
    return lambda *args, **kwargs: by(make(*args, **kwargs))


def parts_of(n: int, ticks: int) -> dict[str, float]:
    """Return the microseconds of a robot-interval that each part has, and the rest."""
    clockwork = Clockwork()
    noted: list[tuple[float, Counter[str]]] = []

    def note(_time_ns: int = 0) -> None:
        noted.append((time.process_time(), clockwork.seconds.copy()))

    def noting(finish: Function) -> Function:
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            finish(*args, **kwargs)
            note()

        return wrapper

    with TemporaryDirectory(prefix="nrs-") as folder, clockwork.timing(PARTS):
        back = replaced(LAST, noting)
        outcome = run(scenario(n, ticks), Path(folder) / "anatomy.mcap", watch=note)
        back()
    assert outcome.status == "completed", outcome.reason
    # Tick 1 is watched by worker and lockstep.
    (began, before), (ended, after) = noted[1], noted[-1]
    us = 1e6 / (n * (ticks - 1))
    found = {part: (after[part] - before[part]) * us for part in PARTS}
    whole = (ended - began) * us
    beside = (after[BESIDE] - before[BESIDE]) * us
    return {**found, REST: whole - sum(found.values()), ALL: whole, BESIDE: beside}


def main() -> None:
    """Print the table, and write it as JSON beside."""
    parser = ArgumentParser(description="where each microsecond of a robot-interval goes")
    parser.add_argument("--robots", type=int, nargs="+", default=[6, 100, 1000, 10_000])
    parser.add_argument("--intervals", type=int, default=100_000, help="of one run")
    parser.add_argument("--rounds", type=int, default=5)
    given = parser.parse_args()
    of = machine()
    print(text(of))
    print(f"us of processor time a robot-interval; the least of {given.rounds} runs\n")
    print(f"{'robots':32}" + "".join(f"{n:>10,}" for n in given.robots))
    columns = {}
    for n in given.robots:
        ticks = max(given.intervals // n, 20)
        rounds = [parts_of(n, ticks) for _ in range(given.rounds)]
        columns[n] = min(rounds, key=lambda found: found[ALL]) | floor(n, ticks)
    for part in columns[given.robots[0]]:
        print(f"{part:32}" + "".join(f"{found[part]:>10.3f}" for found in columns.values()))
    keep("anatomy", {"machine": of, "us": columns})


if __name__ == "__main__":
    main()
