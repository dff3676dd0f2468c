"""What a name means in an FMU: the variable that has it, else the only family of that stem."""

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Family, families
from nrs_cosim.plant_fmu.archives.records import ModelVariable
from nrs_cosim.plant_fmu.errors import FmuError

Identity = tuple[str, int]


def find_variables(archive: Archive, name: str) -> tuple[ModelVariable, ...]:
    """Return the variable of a name or the family of which it is the stem; empty when neither."""
    if name in by_name(archive):
        return (variable_named(archive, name),)
    found = [f for f in families(name, by_name(archive)) if f.entries[0].startswith(name)]
    return only(archive, name, found, "write the names of its entries one by one")


def only(
    archive: Archive, stem: str, found: Sequence[Family], advice: str
) -> tuple[ModelVariable, ...]:
    """Return the variables of the only family; those of the same numbers are one."""
    different: dict[tuple[Identity, ...], tuple[Family, tuple[ModelVariable, ...]]] = {}
    for family in found:
        variables = tuple(variable_named(archive, entry) for entry in family.entries)
        different.setdefault(tuple(map(identity, variables)), (family, variables))
    if len(different) > 1:
        entries = " or ".join(listed(family.entries, 3) for family, _ in different.values())
        raise FmuError(f"{archive.label}: {quoted(stem)} may be {entries}; {advice}")
    return next((variables for _, variables in different.values()), ())


def identity(variable: ModelVariable) -> Identity:
    """Return what a variable shares with its aliases alone.

    In FMI 2.0 each type that has calls of its own counts its references, and an enumeration is
    passed as an Integer (section 2.2.7); in FMI 3.0 references are counted over all types.
    """
    return "Integer" if variable.type == "Enumeration" else variable.type, variable.valueReference


def variable_named(archive: Archive, name: str) -> ModelVariable:
    """Return the variable of a name; `FmuError` when there is none, or more than one."""
    variables = by_name(archive).get(name, ())
    if len(variables) > 1:
        raise FmuError(f"{archive.label}: has {len(variables)} variables named {quoted(name)}")
    if not variables:
        raise FmuError(
            f"{archive.label}: has no variable {quoted(name)}{suggestion(name, by_name(archive))}"
        )
    return variables[0]


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return the nearest known names, or all without their indices, as the end of a sentence."""
    known = list(known)
    if close := get_close_matches(name, known, n=3, cutoff=0.5):
        return f"; did you mean {' or '.join(map(quoted, close))}?"
    return f"; it has {listed(list(dict.fromkeys(k.partition('[')[0] for k in known)))}."


def listed(names: Sequence[str], most: int = 12) -> str:
    """Return names joined by commas, the last of many left out."""
    more = f", … ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + more


@lru_cache(maxsize=16)
def by_name(archive: Archive) -> Mapping[str, Sequence[ModelVariable]]:
    """Return all variables by name."""
    found: dict[str, list[ModelVariable]] = {}
    for variable in archive.description.modelVariables:
        found.setdefault(variable.name, []).append(variable)
    return found
