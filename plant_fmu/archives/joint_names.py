"""A name tells a quantity and a joint: `shoulder_angle`, `elbow_angle` are q of two joints.

What is left of a name without the words of its quantity is the joint's, or a part of that in one
place: `arm.out_shoulder.phi` is of `arm.out_shoulder`, and `shoulder` of all whose names have `arm`
and `out` about it. So one quantity has families, and what stands for the same joints goes together.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

from nrs_cosim.plant_fmu.archives.name_words import Causality, Words, said, words_of
from nrs_cosim.plant_fmu.archives.records import ModelVariable

MOST_WORDS = 16
"""Of a name of which a part may be the joint."""
_GAP = ""
"""Stands where the joint does among the words about it."""


@dataclass(frozen=True, slots=True, eq=False)
class JointFamily:
    """What stands for one quantity of several joints."""

    named: bool
    """Whether their names say which quantity they are."""
    about: Words
    """The words that they have in common, beside those that say that."""
    joints: Mapping[Words, ModelVariable]
    """In the order in which they are declared."""


def joint_families(
    variables: Iterable[ModelVariable],
    quantities: Mapping[str, Causality],
    by_unit: Callable[[ModelVariable, str], int | None],
) -> dict[str, list[JointFamily]]:
    """Return the families of two joints and more of each quantity, of a causality each.

    A unit says something, or nothing, or, as None, that it is another's. A name that does not say
    what it is may belong to a family where its unit does, or as an input to one of torques.
    """
    found: defaultdict[tuple[str, str, bool, Words], dict[Words, ModelVariable]]
    found = defaultdict(dict)
    for variable in variables:
        causality: Causality = "input" if variable.causality == "input" else "moving"
        units = {
            ours: by_unit(variable, ours) for ours, of in quantities.items() if of == causality
        }
        asked = {ours: unit for ours, unit in units.items() if unit is not None}
        for joint, words in _places(words_of(variable.name)):
            says, about = said(words, causality)
            for ours, unit in asked.items():
                if ours == says:
                    found[ours, variable.causality, True, about].setdefault(joint, variable)
                elif unit or (ours == "tau" and not says):
                    found[ours, variable.causality, False, words].setdefault(joint, variable)
        says, rest = said(words_of(variable.name), causality)
        if says in asked and rest:
            found[says, variable.causality, True, ()].setdefault(rest, variable)
    families: dict[str, list[JointFamily]] = {ours: [] for ours in quantities}
    for (ours, _, named, about), joints in found.items():
        if len(joints) > 1:
            families[ours].append(JointFamily(named, tuple(filter(None, about)), joints))
    return families


def _places(words: Words) -> Iterator[tuple[Words, Words]]:
    """Yield what may be the joint, and the words about it."""
    for first in range(len(words) if len(words) <= MOST_WORDS else 0):
        for last in range(first + 1, len(words) + 1):
            yield words[first:last], (*words[:first], _GAP, *words[last:])
