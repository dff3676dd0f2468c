"""Which names may stand for q, q̇ and tau of an FMU that calls them otherwise: what to write.

Candidates are scalars, one-dimensional arrays, and families of scalars whose names differ in one
index. Those go together that are as many as one another, where q̇ is declared the derivative of q,
or where units or names say what they are; the torque is an input, or two are the reference.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import prod

from fmpy.model_description import ModelVariable

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import NamePattern, Spec, as_toml
from nrs_cosim.plant_fmu.archives.lookup import by_name
from nrs_cosim.plant_fmu.archives.quantities import TYPES, UNITS
from nrs_cosim.plant_fmu.archives.units import si_factor, unit_of
from nrs_cosim.plant_fmu.archives.variables import MOVING, NO_SIZES, shape_of

_INDEX = re.compile(r"(?<!\d)(?:0|[1-9]\d*)(?!\d)")
_WORDS = {
    "q": r"q|phi|theta|angle|ang|pos|position|s|x",
    "qd": r"qd|dq|q_?dot|w|omega|v|vel|velocity|speed|d?phid?|d?theta_?d(ot)?",
    "tau": r"tau|torque|trq|u|f|force|effort|m",
    "position_ref": r"(q|phi|theta|angle|pos|position|s)_?(ref|set|des|cmd|d)",
    "velocity_ref": r"(qd|dq|w|omega|v|vel|velocity|speed)_?(ref|set|des|cmd|d)",
}
"""Of which of a name's words one may be, its digits apart."""
MOST = 3
"""Proposals that are as good as one another."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    spec: Spec
    variables: tuple[ModelVariable, ...]
    size: int

    def evidence(self, archive: Archive, ours: str) -> int | None:
        """Return how much says that it is a quantity of ours; None where its unit is another's."""
        unit = unit_of(self.variables[0])
        if unit:
            try:
                si_factor(unit, archive.description.unitDefinitions, UNITS[ours])
            except ValueError:
                return None
        words = re.split(r"[^a-z]+", re.sub(r"\d", "", self.variables[0].name.lower()))
        named = any(re.fullmatch(_WORDS[ours], "_".join(words[i:])) for i in range(len(words)))
        named = named or any(re.fullmatch(_WORDS[ours], word) for word in words)
        return 2 * bool(unit) + named


def proposals(
    archive: Archive, names: Mapping[str, Spec], sizes: Mapping[int, int] = NO_SIZES
) -> list[Mapping[str, Spec]]:
    """Return what `variables` of a plant may have, the best alone; what is named there stays."""
    candidates = _candidates(archive, sizes)
    moving = [c for c in candidates if c.variables[0].causality in MOVING]
    inputs = [c for c in candidates if c.variables[0].causality == "input"]
    found: defaultdict[int, list[Mapping[str, Spec]]] = defaultdict(list)
    for inside, score, size in _pairs(archive, moving):
        for ours in (("tau",), ("position_ref", "velocity_ref")):
            for given in product(*([c for c in inputs if c.size == size] for _ in ours)):
                scores = [c.evidence(archive, name) for c, name in zip(given, ours, strict=True)]
                known = [number for number in scores if number is not None]
                # References are taken for such by what says so alone: any inputs are two.
                if len(known) < len(scores) or (len(ours) > 1 and min(known) < 1):
                    continue
                if len(set(map(id, given))) < len(given):
                    continue
                roles = dict(zip(ours, (c.spec for c in given), strict=True))
                found[score + sum(known)].append({**inside, **roles, **names})
    return found[max(found)][:MOST] if found else []


def as_line(proposal: Mapping[str, Spec]) -> str:
    """Return a proposal as a line of a scenario's table."""
    return f"variables = {{ {entries_of(proposal)} }}"


def entries_of(proposal: Mapping[str, Spec]) -> str:
    """Return the inside of that table."""
    return ", ".join(f"{ours} = {as_toml(spec)}" for ours, spec in proposal.items())


def _pairs(
    archive: Archive, moving: Sequence[_Candidate]
) -> Iterator[tuple[Mapping[str, Spec], int, int]]:
    """Yield what may be q and q̇, how much says so, and how many numbers each has."""
    first = {id(c.variables[0]): c for c in moving}
    hints = {ours: {id(c): c.evidence(archive, ours) for c in moving} for ours in ("q", "qd")}
    for rate in moving:
        as_rate = hints["qd"][id(rate)]
        if as_rate is None:
            continue
        integral = first.get(id(rate.variables[0].derivative))
        declared = integral is not None and integral.size == rate.size
        for of in [integral] if declared else moving:
            as_angle = hints["q"][id(of)]
            if as_angle is None or of is rate or of is None or of.size != rate.size:
                continue
            if declared or (as_angle and as_rate):
                yield {"q": of.spec, "qd": rate.spec}, 4 * declared + as_angle + as_rate, of.size


def _candidates(archive: Archive, sizes: Mapping[int, int]) -> list[_Candidate]:
    known = {name: v[0] for name, v in by_name(archive).items() if len(v) == 1}
    reals = {name: v for name, v in known.items() if v.type in TYPES}
    families: defaultdict[str, dict[int, ModelVariable]] = defaultdict(dict)
    found, among = [], set[str]()
    for name, variable in reals.items():
        shape = shape_of(archive, variable, sizes)
        if len(shape) == 1:
            found.append(_Candidate(name, (variable,), prod(shape)))
        for index in () if shape else _INDEX.finditer(name):
            pattern = f"{name[: index.start()]}{{i}}{name[index.end() :]}"
            families[pattern][int(index[0])] = variable
    for pattern, entries in families.items():
        base, variables = min(entries), [entries[i] for i in sorted(entries)]
        alike = {(v.causality, unit_of(v)) for v in variables}
        whole = base in {0, 1} and max(entries) == base + len(entries) - 1
        if whole and len(entries) > 1 and len(alike) == 1:
            found.append(_Candidate(NamePattern(pattern, base), tuple(variables), len(entries)))
            among |= {v.name for v in variables}
    singles = [v for v in reals.values() if not v.dimensions and v.name not in among]
    return found + [_Candidate(v.name, (v,), 1) for v in singles]
