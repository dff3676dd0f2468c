"""FMUs of strangers, made of a bundled one: its binary, and a model description written anew.

FMI binds variables by their references, so that a renamed archive still runs.
"""

import re
from collections.abc import Callable
from pathlib import Path
from zipfile import ZipFile

from nrs_cosim.plant_fmu.bundled.builder import build

NAME = "modelDescription.xml"


def description(fmi: int, model: str = "two_link_arm") -> str:
    """Return a bundled model's description."""
    with ZipFile(build(model, fmi)) as archive:
        return archive.read(NAME).decode()


def rewritten(
    path: Path, fmi: int, edit: Callable[[str], str], model: str = "two_link_arm"
) -> Path:
    """Write a bundled model's archive with an edited description."""
    with ZipFile(build(model, fmi)) as source, ZipFile(path, "w") as target:
        for entry in source.infolist():
            content = source.read(entry)
            target.writestr(entry, edit(content.decode()) if entry.filename == NAME else content)
    return path


def with_variables(path: Path, fmi: int, variables: str, units: str = "", types: str = "") -> Path:
    """Write an archive whose variables, units and types are these alone; it is not to be run."""

    def edit(text: str) -> str:
        for tag, content in (
            ("ModelStructure", ""),
            ("ModelVariables", variables),
            ("UnitDefinitions", units),
        ):
            text = re.sub(
                f"<{tag}>.*</{tag}>",
                lambda _, t=tag, c=content: f"<{t}>{c}</{t}>",
                text,
                flags=re.DOTALL,
            )
        return text.replace(
            "<LogCategories>", f"<TypeDefinitions>{types}</TypeDefinitions><LogCategories>"
        )

    return rewritten(path, fmi, edit)


def reals(*names: str, unit: str = "") -> str:
    """Return FMI 2 variables, numbered in their order."""
    said = f' unit="{unit}"' if unit else ""
    return "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}"><Real{said}/></ScalarVariable>'
        for i, name in enumerate(names)
    )


def renamed(text: str, name: Callable[[str, list[int]], str]) -> str:
    """Rename every entry `stem[i]` or `stem[i,j]` of a description."""

    def rename(match: re.Match[str]) -> str:
        stem, indices = match[1], [int(i) for i in match[2].split(",")]
        if stem.startswith("der("):
            return match[0]
        return f'name="{name(stem, indices)}"'

    return re.sub(r'name="(\w+)\[([\d,]+)\]"', rename, text)


def moved(path: Path, fmi: int, to: str, *others: str, sources: bool = False) -> Path:
    """Write the two-link arm's archive with its library elsewhere, and with empty entries more."""
    with ZipFile(build("two_link_arm", fmi)) as source, ZipFile(path, "w") as target:
        for name in source.namelist():
            if sources or not name.startswith("sources/"):
                target.writestr(to if name.startswith("binaries/") else name, source.read(name))
        for name in others:
            target.writestr(name, b"")
    return path


def sources_alone(path: Path, fmi: int) -> Path:
    """Write the two-link arm's archive with its sources and without its library."""
    return moved(path, fmi, "binaries/readme", sources=True)
