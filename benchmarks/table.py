"""What the benchmarks have in common: who measured, ratios of rounds that take turns, and JSON."""

import json
import os
import platform
import statistics
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).with_name("results")
_PARTS = ("nrs-cosim", "fmpy", "eclipse-zenoh", "mcap", "numpy", "zstandard")


def machine() -> dict[str, str]:
    """Return what measures: processor, system, versions."""
    return {
        "processor": _processor(),
        "cores": str(os.cpu_count()),
        "platform": platform.platform(),
        "python": platform.python_version(),
        **{part: version(part) for part in _PARTS},
    }


def text(of: Mapping[str, str]) -> str:
    """Return a machine as lines."""
    parts = ", ".join(f"{part} {of[part]}" for part in ("python", *_PARTS))
    return f"{of['processor']}, {of['cores']} cores, {of['platform']}\n{parts}"


def compared(ours: Sequence[float], theirs: Sequence[float]) -> dict[str, float]:
    """Return the median, least and greatest of the rounds' own ratios."""
    ratios = [a / b for a, b in zip(ours, theirs, strict=True)]
    return {
        "ratio": statistics.median(ratios),
        "ratio_min": min(ratios),
        "ratio_max": max(ratios),
    }


def keep(name: str, result: Any) -> None:
    """Write a result as JSON, and say where."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    path.write_text(json.dumps(result, indent=2) + "\n", "utf-8")
    print(f"\nwritten to {path}\n")


def _processor() -> str:
    with Path("/proc/cpuinfo").open(encoding="utf-8") as text:
        names = [line.partition(":")[2].strip() for line in text if line.startswith("model name")]
    return names[0] if names else platform.processor()
