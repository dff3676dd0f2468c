"""An algorithm says how an estimate jumps at a sampling time, and when that converges.

It is a pure function of what was heard, and works alike on one robot, (m,), and on many, (n, m).
Others' packages add algorithms through the entry-point group `nrs.algorithms`; what they do wrong
is told by `foreign`.
"""

import os
import sys
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.parameters import Parameter, declared_parameters
from nrs_cosim.estimator_agents.plugins import Foreign, loaded
from nrs_cosim.estimator_agents.receive_buffer import POLICIES, Missing

GROUP = "nrs.algorithms"

Spectrum = NDArray[np.complex128]
Spectra = tuple[Spectrum, ...]
"""Of D; of the positions' and of the velocities' D where these are two."""


def name_of(algorithm: "Algorithm") -> str:
    """Return what an algorithm is called in errors."""
    return str(getattr(algorithm, "name", type(algorithm).__name__))


class Algorithm(Protocol):
    """A distributed estimator: a dataclass, whose fields are its parameters."""

    missing: ClassVar[tuple[Missing, ...]]
    """What its agents may do without a sample of an in-neighbour; the first unless asked."""

    def jump(self, estimate: Estimate, heard: Disagreement) -> Estimate:
        """Return ε_i(t_k⁺), υ_i(t_k⁺) from the left limits and the disagreement, at t_k."""

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:
        """Return the eigenvalues of the error's recursion, one axis of m, from those of D.

        None at all, an empty array, where the jump is not linear.
        """

    def conditions(self, spectrum: Spectrum, h: float) -> Sequence[Condition]:
        """Return the stability conditions for the eigenvalues s_i of D and the period h (s)."""


class Hetero(Algorithm, Protocol):
    """An algorithm whose positions and velocities may come over different digraphs; optional.

    One that says so has an empty `one_digraph`, and its jump of either quantity depends on that
    alone. Others have no `one_digraph`, or say in it why not.
    """

    one_digraph: ClassVar[str]
    """Why positions and velocities must be heard over one digraph; empty where they need not."""

    def modes(self, spectrum: Spectrum, h: float, velocity: Spectrum | None = None) -> Spectrum:
        """Return the same of the positions' D, and of the velocities' where that is another."""

    def conditions(
        self, spectrum: Spectrum, h: float, velocity: Spectrum | None = None
    ) -> Sequence[Condition]:
        """Return the same of the positions' D, and of the velocities' where that is another."""


@runtime_checkable
class Demanding(Protocol):
    """An algorithm whose conditions are also on the target's motion; this is optional."""

    def demands(self, h: float, gamma_1: float, gamma_2: float) -> Sequence[Condition]:
        """Return conditions on the period h (s) and on the largest |υ_0| and |a_0| (A1)."""


def modes(algorithm: Algorithm, spectra: Spectra, h: float) -> Spectrum:
    """Return an algorithm's modes on its digraph, or on its two."""
    modes_of: Any = algorithm.modes
    found: Spectrum = modes_of(spectra[0], h, *spectra[1:])
    return found


def conditions(algorithm: Algorithm, spectra: Spectra, h: float) -> Sequence[Condition]:
    """Return an algorithm's conditions on its digraph, or on its two."""
    conditions_of: Any = algorithm.conditions
    found: Sequence[Condition] = conditions_of(spectra[0], h, *spectra[1:])
    return found


def demands(algorithm: Algorithm, h: float, gamma_1: float, gamma_2: float) -> Sequence[Condition]:
    """Return what an algorithm demands of the target's motion: nothing, for most."""
    return algorithm.demands(h, gamma_1, gamma_2) if isinstance(algorithm, Demanding) else ()


def algorithm_names() -> tuple[str, ...]:
    """Return the names of all installed algorithms."""
    return tuple(sorted({entry.name for entry in _entries()}))


def bundled_algorithms() -> tuple[str, ...]:
    """Return the names of those that are modules here."""
    return tuple(sorted({entry.name for entry in _entries() if _is_ours(entry)}))


def load_algorithm(name: str, parameters: Mapping[str, Any]) -> Algorithm:
    """Return an installed algorithm with its parameters.

    Raises `InputError` if there is none of that name, or it does not take them.
    """
    entry = _entry(name)
    build: Any = entry.load() if _is_ours(entry) else partial(Foreign.built, entry)
    algorithm: Algorithm = build(**parameters)
    return algorithm


def algorithm_class(name: str) -> Any:
    """Return the class of an installed algorithm; `InputError` if there is none of that name."""
    entry = _entry(name)
    return entry.load() if _is_ours(entry) else loaded(entry)


def parameters_of(name: str) -> tuple[Parameter, ...]:
    """Return what parameters an installed algorithm declares.

    Raises `InputError` if there is none of that name, or what it declares is wrong.
    """
    return declared_parameters(algorithm_class(name), name)


def policies_of(name: str) -> tuple[Missing, ...]:
    """Return what an algorithm's agents may do without a sample, the default first.

    Raises `InputError` if there is no such algorithm, or when it does not say.
    """
    policies: tuple[Missing, ...] = getattr(algorithm_class(name), "missing", ())
    if not policies or not set(policies) <= set(POLICIES):
        raise InputError(
            f"algorithm.name: {name} does not say what its agents do without a sample; let its "
            f"class have an attribute missing with some of {', '.join(POLICIES)}"
        )
    return policies


def why_one_digraph(name: str) -> str:
    """Return why an algorithm must hear positions and velocities over one digraph; empty if not.

    Raises `InputError` if there is no such algorithm.
    """
    why: str = getattr(
        algorithm_class(name), "one_digraph", "it does not say that it can, by an empty one_digraph"
    )
    return why


def _is_ours(entry: EntryPoint) -> bool:
    return entry.module.rpartition(".")[0] == __package__


def _entry(name: str) -> EntryPoint:
    found = next((entry for entry in _entries() if entry.name == name), None)
    if found is None:
        raise InputError(
            f"algorithm.name: expected one of {', '.join(algorithm_names())}, got {quoted(name)}"
        )
    return found


def _entries() -> tuple[EntryPoint, ...]:
    """Return what is installed; looked for again where a folder of packages has changed."""
    return _entries_of(tuple((path, _changed(path)) for path in sys.path))


@lru_cache(maxsize=1)  # every package that is installed is asked, in 10 ms, thrice for a scenario
def _entries_of(_folders: tuple[tuple[str, int | None], ...]) -> tuple[EntryPoint, ...]:
    return tuple(entry_points(group=GROUP))


def _changed(folder: str) -> int | None:
    try:
        return os.stat(folder or os.curdir).st_mtime_ns  # noqa: PTH116 (a folder may be empty)
    except OSError:  # as a path of nothing, which stands in sys.path all the same
        return None
