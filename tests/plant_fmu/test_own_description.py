"""What is read of a bundled model without FMPy is what FMPy reads of it."""

import ast
from dataclasses import fields
from pathlib import Path
from typing import Any

import attrs
import fmpy
import pytest

from nrs_cosim.plant_fmu import platform_names
from nrs_cosim.plant_fmu.archives.archive import Archive, read_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def asked() -> set[str]:
    """All names of attributes that are read where descriptions are, of whatever."""
    paths = [p for folder in ("plant_fmu", "orchestrator") for p in (ROOT / folder).rglob("*.py")]
    nodes = [node for path in paths for node in ast.walk(ast.parse(path.read_text("utf-8")))]
    return {node.attr for node in nodes if isinstance(node, ast.Attribute)}


def pairs(own: Any, other: Any, asked: set[str], seen: dict[int, Any]) -> None:
    """Compare records with FMPy's in all that is asked of them, each once."""
    if isinstance(other, list):
        for each in zip(own, other, strict=True):
            pairs(*each, asked, seen)
    elif not attrs.has(type(other)):
        assert (type(own), own) == (type(other), other)
    elif id(other) in seen:
        assert seen[id(other)] is own, "who is named twice is one"
    else:
        seen[id(other)] = own
        # Lines are told of names that are not structured, as a bundled model's are.
        for name in {field.name for field in attrs.fields(type(other))} & asked - {"sourceline"}:
            pairs(getattr(own, name), getattr(other, name), asked, seen)


@pytest.mark.parametrize("name", bundled_models())
def test_a_bundled_model_is_described_as_fmpy_describes_it(name, asked):
    path, seen = build(name), {}
    ours, theirs = read_archive(path, name, bundled=True), read_archive(path, name)
    pairs(ours.description, theirs.description, asked, seen)
    assert len(seen) > len(theirs.description.modelVariables)
    assert ours.description.fmiMajorVersion == theirs.description.fmiMajorVersion
    for field in {field.name for field in fields(Archive)} - {"description", "bundled"}:
        assert getattr(ours, field) == getattr(theirs, field), field
    assert ours.describe() == theirs.describe()


def test_this_platform_is_called_as_fmpy_calls_it():
    ours = platform_names.FMI3, platform_names.FMI2, platform_names.LIBRARY
    assert ours == (fmpy.platform_tuple, fmpy.platform, fmpy.sharedLibraryExtension)
