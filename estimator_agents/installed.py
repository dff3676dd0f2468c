"""The algorithms that are installed: those here, and others' through the group `nrs.algorithms`.

What others' packages do wrong is one line, which says where (`plugins`).
"""

import os
import sys
from collections.abc import Mapping
from functools import lru_cache, partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.algorithm import Algorithm, Missing
from nrs_cosim.estimator_agents.parameters import Parameter, declared_parameters
from nrs_cosim.estimator_agents.plugins import ThirdParty, loaded

GROUP = "nrs.algorithms"
BUNDLED = {
    "dcea1": "dcea1:FirstOrder",
    "dcea2": "dcea2:SecondOrder",
    "dcea3": "dcea3:ThirdOrder",
    "dynamic_average": "dynamic_average:DynamicAverage",
    "event_triggered": "event_triggered:EventTriggered",
    "impulsive": "impulsive:Impulsive",
    "kalman_consensus": "kalman_consensus:KalmanConsensus",
    "max_consensus": "max_consensus:MaxConsensus",
    "pd_like": "pd_like:PdLike",
    "pi_consensus": "pi_consensus:PIConsensus",
    "push_sum": "push_sum:PushSum",
    "sliding": "sliding:Sliding",
    "wmsr": "wmsr:Wmsr",
}
"""Those that are here, by name: module and class. No other package may take their names."""


def algorithm_names() -> tuple[str, ...]:
    """Return the names of all installed algorithms."""
    return tuple(sorted({*BUNDLED, *(entry.name for entry in _others())}))


def is_installed(name: str) -> bool:
    """Return whether there is an algorithm of this name."""
    return name in BUNDLED or any(entry.name == name for entry in _others())


def bundled_algorithms() -> tuple[str, ...]:
    """Return the names of those that are modules here."""
    return tuple(sorted(BUNDLED))


def load_algorithm(name: str, parameters: Mapping[str, Any]) -> Algorithm:
    """Return an installed algorithm with its parameters.

    Raises `InputError` if there is none of that name, or it does not take them.
    """
    build: Any = _bundled(name) or partial(ThirdParty.built, _entry(name))
    algorithm: Algorithm = build(**parameters)
    return algorithm


def algorithm_class(name: str) -> type[Algorithm]:
    """Return the class of an installed algorithm; `InputError` if there is none of that name."""
    return _bundled(name) or loaded(_entry(name))


def package_of(name: str) -> str:
    """Return the package, its version and the entry point of an algorithm; empty of one of ours."""
    if name in BUNDLED:
        return ""
    entry = _entry(name)
    package = [entry.dist.name, entry.dist.version] if entry.dist else []
    return " ".join([*package, f"({entry.value})"])


def parameters_of(name: str) -> tuple[Parameter, ...]:
    """Return what parameters an installed algorithm declares.

    Raises `InputError` if there is none of that name, or what it declares is wrong.
    """
    return declared_parameters(algorithm_class(name), name)


def policies_of(name: str) -> tuple[Missing, ...]:
    """Return what an algorithm's agents may do without a sample, the default first.

    Raises `InputError` if there is no such algorithm, or when what it declares is wrong.
    """
    return algorithm_class(name).MISSING


def takes_separate_graphs(name: str) -> bool:
    """Return whether positions and velocities may be received over digraphs of their own.

    Raises `InputError` as `policies_of`.
    """
    return algorithm_class(name).SEPARATE_GRAPHS


def _bundled(name: str) -> type[Algorithm] | None:
    """Return the class of one that is here, without a look at what else is installed."""
    if name not in BUNDLED:
        return None
    module, _, kind = BUNDLED[name].partition(":")
    found: type[Algorithm] = getattr(import_module(f"{__package__}.{module}"), kind)
    return found


def _entry(name: str) -> EntryPoint:
    found = next((entry for entry in _others() if entry.name == name), None)
    if found is None:
        raise InputError(
            f"algorithm.name: expected one of {', '.join(algorithm_names())}, got {quoted(name)}"
        )
    return found


def _others() -> tuple[EntryPoint, ...]:
    """Return what others install: looked for again where a folder has changed."""
    found = _entries_of(tuple(_packages(path, _changed(path)) for path in sys.path))
    return tuple(entry for entry in found if entry.name not in BUNDLED)


@lru_cache(maxsize=1)  # every package that is installed is asked, in 10 ms, thrice for a scenario
def _entries_of(
    _folders: tuple[tuple[tuple[str, int | None], ...], ...],
) -> tuple[EntryPoint, ...]:
    return tuple(entry_points(group=GROUP))


@lru_cache(maxsize=64)  # where a study or a recording is written, other files come and go
def _packages(folder: str, changed: int | None) -> tuple[tuple[str, int | None], ...]:
    """Return which packages a folder has, and when each was changed; or of a file, when it was."""
    try:
        with os.scandir(folder or os.curdir) as found:
            return tuple(
                sorted(
                    (one.name, one.stat().st_mtime_ns)
                    for one in found
                    if one.name.endswith((".dist-info", ".egg-info"))
                )
            )
    except OSError:
        return ((folder, changed),)


def _changed(folder: str) -> int | None:
    try:
        return os.stat(folder or os.curdir).st_mtime_ns  # noqa: PTH116 (a folder may be empty)
    except OSError:  # as a path of nothing, which stands in sys.path all the same
        return None
