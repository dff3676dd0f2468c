"""What a recording says of its run, with the theory beside it: one result, whoever shows it.

`nrs run` stores the theory at the end of a run that came to it. It is taken from there as what was
measured is, where checksums vouch for the file, and where this version computed it: another may
know more.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from math import isclose
from pathlib import Path
from typing import Any

from nrs_cosim.orchestrator.engine.summary import describe, lines, measure
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.algorithms import NotInstalled
from nrs_cosim.recordings.mcap.container import END
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState
from nrs_cosim.recordings.metadata import THEORY
from nrs_cosim.recordings.schemas import about
from nrs_cosim.recordings.theory_record import TheoryRecord

_NEAR = 1e-6
"""Relative: how far two machines' linear algebra lets a number of the theory be apart."""


@dataclass(frozen=True, slots=True)
class Result:
    """A run, as it was recorded."""

    described: Mapping[str, Any]
    """What the recording says of itself; see `orchestrator.engine.summary.describe`."""
    measured: SteadyState
    theory: Mapping[str, Any]
    """See `orchestrator.analysis.comparison.TheoryComparison.as_json`."""

    @classmethod
    def of(cls, reader: Reader, experiment: Experiment) -> "Result":
        """Read the recording of an experiment."""
        measured = measure(reader, experiment)
        theory = _stored(reader, experiment) or _computed(reader, experiment, measured)
        return cls(describe(reader, experiment), measured, theory)

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {**self.described, "theory": self.theory}

    def lines(self) -> dict[str, str]:
        """Return what a person reads of the run, as short lines by name."""
        return lines(self.described, self.measured)


def theory_beside(path: Path, experiment: Experiment) -> dict[str, str]:
    """Return what is said of the theory at the end of a run, whose recording is whole.

    Nothing where it has a number that is not finite.
    """
    with Reader(path) as reader:
        found = _computed(reader, experiment, measure(reader, experiment))
    try:
        return {THEORY: TheoryRecord.model_validate(found).model_dump_json()}
    except ValueError:
        return {}


def wrong_theory(reader: Reader, theory: Mapping[str, Any]) -> str:
    """Say that what was stored of a whole run is not what is computed, where it is not."""
    found = reader.ending.theory if reader.ending and reader.computed and reader.digest else None
    if found is None or not _is_ours(reader) or _alike(found.as_json(), theory):
        return ""
    return f"{END}: {THEORY}: is not what the scenario and the messages give"


def _computed(reader: Reader, experiment: Experiment, measured: SteadyState) -> dict[str, Any]:
    # Where it is stored, all that computes it stays away.
    from nrs_cosim.orchestrator.analysis.comparison import (  # noqa: PLC0415, as said
        compare_to_theory,
    )

    return compare_to_theory(reader, experiment, measured).as_json()


def _stored(reader: Reader, experiment: Experiment) -> dict[str, Any] | None:
    """Return what a run said of the theory; None where it did not, or is not to be believed."""
    found = reader.ending.theory if reader.ending and not reader.computed else None
    missing = isinstance(experiment.scenario.algorithm, NotInstalled)
    if found is None or missing or experiment.text != about(reader).scenario:
        return None
    return found.as_json() if _is_ours(reader) else None


def _is_ours(reader: Reader) -> bool:
    return about(reader).versions.get("nrs-cosim") == version("nrs-cosim")


def _alike(stored: Any, computed: Any) -> bool:
    """Return whether two values of JSON are the same but for rounding."""
    if isinstance(stored, dict) and isinstance(computed, dict):
        same = stored.keys() == computed.keys()
        return same and all(_alike(value, computed[key]) for key, value in stored.items())
    if isinstance(stored, list) and isinstance(computed, list | tuple):
        return len(stored) == len(computed) and all(map(_alike, stored, computed))
    if isinstance(stored, float) and isinstance(computed, float):
        return isclose(stored, computed, rel_tol=_NEAR, abs_tol=_NEAR**2)
    return bool(stored == computed)
