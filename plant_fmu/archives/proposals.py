"""Which names may stand for q, q̇ and tau of an FMU that calls them otherwise: what to write.

Candidates are scalars, one-dimensional arrays, families of scalars whose names differ in one index,
and families by joint (`joint_names`). Those go together that are as many as one another, and of the
same joints where names tell them, where q̇ is declared the derivative of q, or where units or names
say what they are; the torque is an input, or two are the reference.
"""

import re
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain, islice, permutations, product
from math import prod

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import NamePattern, Spec, as_toml
from nrs_cosim.plant_fmu.archives.joint_names import JointFamily, joint_families
from nrs_cosim.plant_fmu.archives.lookup import Identity, by_name, identity
from nrs_cosim.plant_fmu.archives.name_words import Causality, Words, said, words_of
from nrs_cosim.plant_fmu.archives.quantities import TYPES, UNITS
from nrs_cosim.plant_fmu.archives.records import ModelVariable
from nrs_cosim.plant_fmu.archives.units import si_factor, unit_of
from nrs_cosim.plant_fmu.archives.variables import MOVING, NO_SIZES, shape_of

_INDEX = re.compile(r"(?<!\d)(?:0|[1-9]\d*)(?!\d)")
_QUANTITIES: dict[str, Causality] = {
    "q": "moving",
    "qd": "moving",
    "tau": "input",
    "position_ref": "input",
    "velocity_ref": "input",
}
_DRIVEN = (("tau",), ("position_ref", "velocity_ref"))
MOST = 6
"""Proposals that are as good as one another."""
MOST_FAMILIES, MOST_COMBINED = 40, 5000
"""Of a quantity, the largest first; of combinations of what is ordered, and of families."""
MOST_ORDERED = 3
"""Joints of which all orders are proposed, where names tell those of some quantities alone."""
Proposal = Mapping[str, Spec]


@dataclass(frozen=True, slots=True)
class Guess:
    """What `variables` may be, as far as a description tells."""

    names: Proposal
    size: int
    """How many numbers are a q."""
    of_same_joints: bool
    """Whether names do not tell that its quantities are of different joints."""


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """What may stand for one quantity."""

    spec: Spec
    variables: tuple[ModelVariable, ...]
    sizes: tuple[int, ...]
    """Of each joint where names tell joints, else of all."""
    evidence: int
    about: Words
    """What its names say beside the quantity."""
    by_joint: bool = False

    @property
    def size(self) -> int:
        return sum(self.sizes)

    def in_order(self, order: Sequence[int]) -> "_Candidate":
        """Return it with its joints in another order; as it is where names tell no joints."""
        if not self.by_joint:
            return self
        variables = tuple(self.variables[i] for i in order)
        spec = tuple(v.name for v in variables)
        sizes = tuple(self.sizes[i] for i in order)
        return replace(self, spec=spec, variables=variables, sizes=sizes)


def proposals(
    archive: Archive, names: Mapping[str, Spec], sizes: Mapping[int, int] = NO_SIZES
) -> list[list[Guess]]:
    """Return what `variables` of a plant may have; what is named there stays.

    Those that are as good as one another are together, the best first.
    """
    search = _Search(archive, sizes)
    found: defaultdict[tuple[int, int], dict[tuple[Identity, ...], Guess]] = defaultdict(dict)
    for score, roles in search.combinations():
        given = {ours: candidate.spec for ours, candidate in roles.items()}
        same = tuple(identity(v) for candidate in roles.values() for v in candidate.variables)
        if len(set(same)) == len(same):
            size = roles["q"].size
            of_same = all(c.by_joint for c in roles.values()) or _alike(_about(roles.values()))
            guess = Guess({**given, **names}, size, of_same)
            # More joints are better among what is else as good: one alone is a part of them.
            found[score, size].setdefault(same, guess)
    return [list(found[key].values())[:MOST] for key in sorted(found, reverse=True)]


def as_line(proposal: Proposal) -> str:
    """Return a proposal as a line of a scenario's table."""
    return f"variables = {{ {entries_of(proposal)} }}"


def entries_of(proposal: Proposal) -> str:
    """Return the inside of that table."""
    return ", ".join(f"{ours} = {as_toml(spec)}" for ours, spec in proposal.items())


class _Search:
    """What an FMU's variables may be, and how they go together."""

    def __init__(self, archive: Archive, sizes: Mapping[int, int]) -> None:
        self._archive = archive
        known = {name: v[0] for name, v in by_name(archive).items() if len(v) == 1}
        reals = [v for v in known.values() if v.type in TYPES]
        shapes = {v.name: shape_of(archive, v, sizes) for v in reals}
        self._flat = [v for v in reals if len(shapes[v.name]) < 2 and _may_be_ours(v)]
        self._size = {v.name: prod(shapes[v.name]) for v in self._flat}
        self._scalar = {v.name for v in self._flat if not shapes[v.name]}
        self._derived: defaultdict[Identity, set[Identity]] = defaultdict(set)
        for v in reals:
            if v.derivative is not None:
                self._derived[identity(v)].add(identity(v.derivative))
        families = joint_families(self._flat, _QUANTITIES, self._by_unit)
        self._families = {
            ours: sorted(some, key=lambda f: -len(f.joints))[:MOST_FAMILIES]
            for ours, some in families.items()
        }
        self._ordered = {
            ours: sorted(self._in_order(ours), key=lambda c: -c.size) for ours in _QUANTITIES
        }

    def combinations(self) -> Iterator[tuple[int, dict[str, _Candidate]]]:
        """Yield what goes together, beside how much says that it does."""
        for driven in _DRIVEN:
            ours = ("q", "qd", *driven)
            together = (self._in_any_order(ours), self._of_same_joints(ours))
            for some in chain.from_iterable(islice(some, MOST_COMBINED) for some in together):
                score = self._score(dict(zip(ours, some, strict=True)))
                if score is not None:
                    yield score, dict(zip(ours, some, strict=True))

    def _in_any_order(self, ours: Sequence[str]) -> Iterator[tuple[_Candidate, ...]]:
        """Yield candidates of equal sizes of which some are ordered, or a number each."""
        state, driven = ours[:2], ours[2:]
        whole = {
            o: [self._of(o, family, list(family.joints)) for family in self._families[o]]
            for o in driven
        }
        for q, qd in chain(self._pairs_in_order(), self._of_same_joints(state)):
            # Names may tell the joints of some alone: then the others' order is taken for theirs.
            pools = [self._ordered[o] + ([] if q.by_joint else whole[o]) for o in driven]
            for given in product(*([c for c in pool if c.size == q.size] for pool in pools)):
                yield from _in_orders((q, qd, *given))

    def _pairs_in_order(self) -> Iterator[tuple[_Candidate, _Candidate]]:
        """Yield q and q̇ of one size, declared to be the one's derivative or both evident."""
        firsts: defaultdict[Identity, list[_Candidate]] = defaultdict(list)
        for q in self._ordered["q"]:
            firsts[identity(q.variables[0])].append(q)
        evident = [q for q in self._ordered["q"] if q.evidence]
        for qd in self._ordered["qd"]:
            integrals = self._derived.get(identity(qd.variables[0]))
            of = [q for i in integrals for q in firsts[i]] if integrals else evident
            yield from ((q, qd) for q in of if q.size == qd.size and (integrals or qd.evidence))

    def _of_same_joints(self, ours: Sequence[str]) -> Iterator[tuple[_Candidate, ...]]:
        """Yield candidates for two joints and more that all have, as many as all have."""
        last = ours[-1]
        for family in self._families[last]:
            among: list[dict[frozenset[Words], list[JointFamily]]] = []
            for other in ours[:-1]:
                by_joints = defaultdict(list)
                for one in self._families[other]:
                    by_joints[frozenset(one.joints.keys() & family.joints.keys())].append(one)
                among.append({joints: of for joints, of in by_joints.items() if len(joints) > 1})
            for chosen in product(*among):
                joints = frozenset.intersection(*chosen)
                if len(joints) < 2:
                    continue
                pools = (of[key] for of, key in zip(among, chosen, strict=True))
                for some in product(*pools, [family]):
                    order = [joint for joint in some[0].joints if joint in joints]
                    candidates = [self._of(o, f, order) for o, f in zip(ours, some, strict=True)]
                    if len({c.sizes for c in candidates}) == 1:
                        yield tuple(candidates)

    def _score(self, roles: Mapping[str, _Candidate]) -> int | None:
        """Return how much says that candidates go together; None where something denies it."""
        q, qd, *driven = roles.values()
        declared = self._declared(q, qd)
        if declared is False or not (declared or (q.evidence and qd.evidence)):
            return None
        # References are taken for such by what says so alone: any inputs are two.
        if len(driven) > 1 and not all(c.evidence for c in driven):
            return None
        mixed = len({c.by_joint for c in roles.values() if c.size > 1} or {True}) - 1
        evidence = sum(c.evidence for c in roles.values())
        return 4 * bool(declared) + evidence - _apart(roles.values()) - mixed

    def _declared(self, q: _Candidate, qd: _Candidate) -> bool | None:
        """Whether q̇ is declared the derivative of q; None where nothing is said of it."""
        if len(q.variables) != len(qd.variables):
            return None
        integrals = [self._derived.get(identity(v), set()) for v in qd.variables]
        if any(of and identity(v) not in of for of, v in zip(integrals, q.variables, strict=True)):
            return False
        return True if all(integrals) else None

    def _in_order(self, ours: str) -> Iterator[_Candidate]:
        """Yield arrays and numbered families, whose order is theirs, and scalars."""
        causality = _QUANTITIES[ours]
        families: defaultdict[str, dict[int, ModelVariable]] = defaultdict(dict)
        variables = [v for v in self._flat if (v.causality == "input") == (causality == "input")]
        among = set[str]()
        for v in variables:
            if v.name not in self._scalar:
                yield from self._one(ours, v.name, (v,))
                among.add(v.name)
                continue
            for index in _INDEX.finditer(v.name):
                families[f"{v.name[: index.start()]}{{i}}{v.name[index.end() :]}"][
                    int(index[0])
                ] = v
        for pattern, entries in families.items():
            base, members = min(entries), tuple(entries[i] for i in sorted(entries))
            alike = {(v.causality, unit_of(v)) for v in members}
            whole = base in {0, 1} and max(entries) == base + len(entries) - 1
            if whole and len(entries) > 1 and len(alike) == 1:
                yield from self._one(ours, NamePattern(pattern, base), members)
                among |= {v.name for v in members}
        for v in variables:
            if v.name not in among:
                yield from self._one(ours, v.name, (v,))

    def _one(
        self, ours: str, spec: Spec, variables: tuple[ModelVariable, ...]
    ) -> Iterator[_Candidate]:
        """Yield a candidate of what is ordered, unless its unit or its name denies it."""
        by_unit = self._by_unit(variables[0], ours)
        says, about = said(words_of(variables[0].name), _QUANTITIES[ours])
        if by_unit is None or (says and says != ours and not by_unit):
            return
        if len(variables) > 1:
            about = tuple(word for word in about if not word.isdigit())
        sizes = (sum(self._size[v.name] for v in variables),)
        yield _Candidate(
            spec, variables, sizes, by_unit + (says == ours), about if says == ours else ()
        )

    def _of(self, ours: str, family: JointFamily, joints: Iterable[Words]) -> _Candidate:
        variables = tuple(family.joints[joint] for joint in joints)
        by_unit = min(self._by_unit(v, ours) or 0 for v in variables)
        return _Candidate(
            tuple(v.name for v in variables),
            variables,
            tuple(self._size[v.name] for v in variables),
            by_unit + family.named,
            family.about,
            by_joint=True,
        )

    def _by_unit(self, variable: ModelVariable, ours: str) -> int | None:
        """Return how much a unit says for a quantity of ours; None where it is another's."""
        unit = unit_of(variable)
        if not unit:
            return 0
        try:
            si_factor(unit, self._archive.description.unitDefinitions, UNITS[ours])
        except ValueError:
            return None
        return 2


def _in_orders(some: tuple[_Candidate, ...]) -> Iterator[tuple[_Candidate, ...]]:
    """Yield candidates as they are, and of few joints that some have in order in others too."""
    joints = next((len(c.variables) for c in some if c.by_joint), 1)
    yield some
    if joints <= MOST_ORDERED and not all(c.by_joint for c in some):
        for order in list(permutations(range(joints)))[1:]:
            yield tuple(c.in_order(order) for c in some)


def _apart(some: Collection[_Candidate]) -> int:
    """Return how much names tell that candidates are of different things."""
    about = _about(some)
    return len(about or {()}) - 1 + (not all(c.by_joint for c in some) and not _alike(about))


def _about(some: Iterable[_Candidate]) -> set[Words]:
    return {c.about for c in some if c.about}


def _alike(about: set[Words]) -> bool:
    """Whether names that say what they are about share a word."""
    return not about or bool(set.intersection(*map(set, about)))


def _may_be_ours(variable: ModelVariable) -> bool:
    return variable.causality in MOVING or variable.causality == "input"
