"""What the benchmarks have in common: the ratio of rounds that take turns, and the JSON beside."""

import json
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).with_name("results")


def compared(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, float]:
    """Return the median, least and greatest of the rounds' own ratios."""
    ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
    return {
        "ratio": statistics.median(ratios),
        "ratio_min": min(ratios),
        "ratio_max": max(ratios),
    }


def spread(row: Mapping[str, float]) -> str:
    """Return what `compared` found, to be printed."""
    return f"{row['ratio']:>6.2f}   {row['ratio_min']:.2f} .. {row['ratio_max']:.2f}"


def keep(name: str, result: Any) -> None:
    """Write a result as JSON, and say where."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(json.dumps(result, indent=2) + "\n", "utf-8")
    print(f"\nwritten to {path}\n")
