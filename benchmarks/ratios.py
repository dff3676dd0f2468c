"""What runs cost beside what does less, as ratios of processor time within one run.

    recorded    a bare loop of pre-bound calls / a recorded run, of a hundred robots
    flat        a robot-interval among a hundred robots / one among a thousand
    writer      `mcap`'s writer / the recording's, on the same messages
    agents      the bare arithmetic of estimates / the agents, of a thousand robots

More is better. Short slices take turns, and of each the least is taken, since noise only adds. A
test holds the ratios against `floors.json`, which `python -m benchmarks.ratios --keep` writes.
"""

import gc
import json
from argparse import ArgumentParser
from collections import defaultdict
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.agents import bare, prepared
from benchmarks.bare import prebound, timed
from benchmarks.measured import recorded
from benchmarks.table import machine
from benchmarks.work import Motion, keep_motion, scenario
from benchmarks.writers import as_columns, mcaps, ours_of_columns, ticks_of

FLOORS = Path(__file__).with_name("floors.json")
MOST_FALL = 1 / 3
"""Of a ratio, against what was kept."""
ROUNDS, MOST = 3, 5
FEW, MANY = (100, 50), (1000, 10)
"""Robots, and the ticks of a slice."""
WRITTEN = 50
"""Ticks of a written slice, of a hundred robots."""


def measured(
    folder: Path,
    rounds: int = ROUNDS,
    is_enough: Callable[[Mapping[str, float]], bool] = lambda _found: True,
) -> dict[str, float]:
    """Return the ratios, of some rounds; of more, up to `MOST` times as many, until it is enough.

    What a machine does beside adds to a slice and never takes from it, so more rounds are nearer.
    """
    path, kept = folder / "run.mcap", folder / "motion.npz"
    recorded(*FEW, 1, path)
    keep_motion(scenario(*FEW), path, kept)
    motion, messages = Motion(kept), ticks_of(FEW[0], WRITTEN)
    columns, of_agents = as_columns(FEW[0], messages), prepared()
    slices: Mapping[str, Callable[[], Mapping[str, float]]] = {
        "few": lambda: recorded(*FEW, 1, path),
        "bare": lambda: prebound(motion),
        "many": lambda: recorded(*MANY, 1, path),
        "ours": lambda: timed(lambda: ours_of_columns(path, FEW[0], columns)),
        "mcap": lambda: timed(lambda: mcaps(path, FEW[0], messages)),
        "arithmetic": lambda: timed(bare),
        "agents": lambda: timed(of_agents),
    }
    found: defaultdict[str, list[float]] = defaultdict(list)
    for turn in range(1, MOST * rounds + 1):
        for name, measure in slices.items():
            gc.collect()
            found[name].append(measure()["cpu"])
        if not turn % rounds and is_enough(ratios := _of(found)):
            break
    return ratios


def _of(found: Mapping[str, list[float]]) -> dict[str, float]:
    least = {name: min(times) for name, times in found.items()}
    per_few, per_many = (
        least[name] / (n * ticks) for name, (n, ticks) in (("few", FEW), ("many", MANY))
    )
    return {
        "recorded": least["bare"] / least["few"],
        "flat": per_few / per_many,
        "writer": least["mcap"] / least["ours"],
        "agents": least["arithmetic"] / least["agents"],
    }


def fallen(found: Mapping[str, float], kept: Mapping[str, float]) -> list[str]:
    """Return which ratios have fallen by more than `MOST_FALL`, in words."""
    return [
        f"{name} fell from {floor:.2f} to {found[name]:.2f}"
        for name, floor in kept.items()
        if found[name] < floor * (1 - MOST_FALL)
    ]


def floors() -> dict[str, float]:
    """Return what was kept."""
    kept: dict[str, float] = json.loads(FLOORS.read_text("utf-8"))["ratios"]
    return kept


def main() -> None:
    """Print the ratios, beside those that were kept, or keep them."""
    parser = ArgumentParser(description="what runs cost beside what does less")
    parser.add_argument("--keep", action="store_true", help="as what later ones may not fall below")
    given = parser.parse_args()
    with TemporaryDirectory(prefix="nrs-") as folder:
        found = measured(Path(folder), rounds=4 * ROUNDS if given.keep else ROUNDS)
    if given.keep:
        text = json.dumps({"ratios": found, "machine": machine()}, indent=2)
        FLOORS.write_text(text + "\n", "utf-8")
    kept = floors()
    for name, ratio in found.items():
        print(f"{name:10}{ratio:>6.2f}   kept {kept[name]:.2f}")


if __name__ == "__main__":
    main()
