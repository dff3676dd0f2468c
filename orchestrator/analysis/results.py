"""What a recording says of its run, with the theory beside it: one result, whoever shows it.

`nrs run` stores the theory at the end of a run that came to it, with a hash of what it follows
from: messages, scenario, and the version that computed it. Where that is all the same, and
checksums vouch for the file, it is taken from there, as what was measured is; `info --verify` and
`replay --verify` compute it anew.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version
from math import isclose
from pathlib import Path
from typing import Any

from nrs_cosim.bus.errors import InputError, RunError
from nrs_cosim.orchestrator.engine.summary import describe, lines, measure, wrong_measurement
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.algorithms import NotInstalled
from nrs_cosim.recordings.mcap.container import END
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState, steady_state
from nrs_cosim.recordings.metadata import THEORY, parse
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

    Nothing where it cannot be computed, or has a number that is not finite.
    """
    try:
        with Reader(path) as reader:
            found = _computed(reader, experiment, measure(reader, experiment))
            record = TheoryRecord.model_validate({"of": _origin(reader), **found})
    except (InputError, RunError, ValueError):
        return {}
    return {THEORY: record.model_dump_json()}


def wrong_theory(reader: Reader, experiment: Experiment, theory: Mapping[str, Any]) -> str:
    """Say that what was stored of a whole run is not what is computed, where it is not."""
    found = _record(reader, experiment) if reader.digest else None
    if found is None or _alike(found.as_json(), theory):
        return ""
    return f"{END}: {THEORY}: is not what the scenario and the messages give"


def wrong_at_end(reader: Reader, experiment: Experiment) -> str:
    """Say what a run stored of its errors at its end that is not what comes out of its messages."""
    measured = steady_state(reader, experiment.target_at, experiment.byzantine)
    wrong = wrong_measurement(reader, measured)
    if not wrong and _record(reader, experiment):
        wrong = wrong_theory(reader, experiment, _computed(reader, experiment, measured))
    return wrong


def _computed(reader: Reader, experiment: Experiment, measured: SteadyState) -> dict[str, Any]:
    # Where it is stored, all that computes it stays away.
    from nrs_cosim.orchestrator.analysis.comparison import (  # noqa: PLC0415, as said
        compare_to_theory,
    )

    return compare_to_theory(reader, experiment, measured).as_json()


def _stored(reader: Reader, experiment: Experiment) -> dict[str, Any] | None:
    """Return what a run said of the theory; None where it did not, or is not to be believed."""
    found = None if reader.computed else _record(reader, experiment)
    return found.as_json() if found else None


def _record(reader: Reader, experiment: Experiment) -> TheoryRecord | None:
    """Return what is stored of this very run by this version; `UnreadableError` if malformed.

    None too where its algorithm is not installed: nothing could be computed beside it here.
    """
    found = reader.ending.theory if reader.ending else None
    missing = isinstance(experiment.scenario.algorithm, NotInstalled)
    if found is None or missing or experiment.text != about(reader).scenario:
        return None
    if found.get("of") != _origin(reader):
        return None
    return parse(reader.path, f"{END}: {THEORY}", TheoryRecord, found)


def _origin(reader: Reader) -> str:
    """Return the SHA-256 of what the theory of a recording follows from."""
    said = about(reader)
    assets = {field: asset.sha256 for field, asset in sorted(said.assets.items())}
    plants = [(group.sha256, group.robots) for group in said.run.plants]
    of = [version("nrs-cosim"), reader.digest_here, said.scenario, assets, plants]
    return sha256(json.dumps(of).encode()).hexdigest()


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
