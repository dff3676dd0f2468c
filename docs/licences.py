"""Writes docs/licences.md: under which licences stands what `pip install nrs-cosim[all]` brings.

    python -m docs.licences docs

Licences are read from what is installed: its expression, else its classifier, else its words. One
that is not in PERMITTED is an error: it wants a person's eye before a user has it.
"""

import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PERMITTED = {
    "0BSD", "Apache-2.0", "BSD", "BSD-2-Clause", "BSD-3-Clause", "CC0-1.0", "EPL-2.0", "ISC",
    "LGPL-3.0", "MIT", "MIT-0", "MIT-CMU", "PSF-2.0", "Zlib",
}  # fmt: skip
WORDS = (
    ("lesser general public license v3", "LGPL-3.0"),
    ("apache", "Apache-2.0"),
    ("eclipse public license 2", "EPL-2.0"),
    ("isc", "ISC"),
    ("mit", "MIT"),
    ("python software foundation", "PSF-2.0"),
    ("bsd-2-clause", "BSD-2-Clause"),
    ("3-clause", "BSD-3-Clause"),
    ("bsd 3-clause", "BSD-3-Clause"),
    ("bsd-3-clause", "BSD-3-Clause"),
    ("bsd", "BSD"),
)
TERMS = "redistribution and use in source and binary forms, with or without"
HEAD = """# Licences of what is installed

nrs-cosim is under the MIT licence. What `pip install nrs-cosim[all]` brings is under these, at the
versions of `constraints.txt`; the core needs those marked so. None is part of nrs-cosim's own
files, and none asks anything of the programs, FMUs, recordings or figures that you make. CasADi,
under the LGPL, is loaded as the library that it is, for URDFs alone; the C that it writes of a
robot is yours.
`python -m docs.licences docs` writes this page.

| package | licence | core |
|---|---|---|
"""


def licence(package: Distribution) -> str:
    """The licence of an installed package, as an SPDX expression; ValueError if it is unknown."""
    stated = package.metadata
    text = stated.get("License-Expression")
    if not text:
        classes = [
            line for line in stated.get_all("Classifier") or () if line.startswith("License")
        ]
        said = " ".join((*classes, *(stated.get("License") or "").split("\n", 1)[:1])).lower()
        found = [name for words, name in WORDS if re.search(rf"\b{words}\b", said)]
        if not found:
            files = [file for file in package.files or () if "licen" in file.name.lower()]
            found = (
                ["BSD"] if any(TERMS in file.read_text("utf-8").lower() for file in files) else []
            )
        if len(found) > 1 and "BSD" in found:
            found.remove("BSD")
        text = " OR ".join(dict.fromkeys(found)) or "unknown"
    if not set(re.split(r" OR | AND |[()]", text)) <= PERMITTED:
        raise ValueError(f"{package.name}: the licence {text!r} is not in PERMITTED of {__file__}")
    return text


def required(wanted: list[str]) -> dict[str, Distribution | None]:
    """Every package that the requirements bring here, by name; None: not installed."""
    found: dict[str, Distribution | None] = {}
    queue = [Requirement(line) for line in wanted]
    seen: set[tuple[str, str]] = set()
    while queue:
        requirement = queue.pop()
        name = canonicalize_name(requirement.name)
        for extra in ("", *requirement.extras):
            if (name, extra) in seen:
                continue
            seen.add((name, extra))
            try:
                found[name] = distribution(name)
            except PackageNotFoundError:
                found[name] = None
                continue
            for line in found[name].requires or ():
                more = Requirement(line)
                if more.marker is None or more.marker.evaluate({"extra": extra}):
                    queue.append(more)
    return dict(sorted(found.items()))


def rows() -> Iterator[tuple[str, str | None, bool]]:
    """Of each package its name, its licence (None: not installed), whether the core needs it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    chosen = Requirement(*extras["all"]).extras
    core = required(project["dependencies"])
    every = required(project["dependencies"] + [line for name in chosen for line in extras[name]])
    for name, package in every.items():
        yield name, None if package is None else licence(package), name in core


def main(folder: str) -> None:
    """Write the page; every package must be installed for it."""
    lines = []
    for name, text, core in rows():
        if text is None:
            raise SystemExit(f"{name} is not installed: pip install -c constraints.txt -e '.[all]'")
        lines.append(f"| {name} | {text} | {'yes' if core else ''} |\n")
    (Path(folder) / "licences.md").write_text(HEAD + "".join(lines), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
