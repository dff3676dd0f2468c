"""What needs a package that not everybody has says so, and which extra brings it."""

import re
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from nrs_cosim.api.recording import Recording
from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_fmu import build_urdf
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.input_tables import file_columns
from nrs_cosim.recordings.mcap.reader import Reader
from tests.recordings.made_up_runs import recorded

ROOT = Path(__file__).parents[2]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"][
    "optional-dependencies"
]
ARM = ROOT / "tests/plant_fmu/robots/two_link_arm.urdf"


def command(*arguments):
    """Run the command, and raise what it ends with."""
    raise CliRunner().invoke(app, [*map(str, arguments)]).exception


def of(method, *arguments):
    """Return what calls a method of a recording."""

    def call(path):
        with Recording(path) as recording:
            getattr(recording, method)(*(path.with_name(name) for name in arguments))

    return call


def exported(path):
    with Reader(path) as reader:
        export(reader, path.parent, "parquet")


NEEDS = {
    "a Dataset": ("xarray", "recordings.export.dataset", of("dataset")),
    "a DataFrame": ("pandas", "", of("to_pandas")),
    "a page": ("plotly", "", of("report", "page.html")),
    "a page that is asked for": (
        "plotly",
        "",
        lambda path: command("report", path, "-o", path.with_suffix(".html")),
    ),
    "figures": (
        "matplotlib",
        "recordings.report.print",
        lambda path: command("report", path, "-o", path.with_suffix(".png")),
    ),
    "a picture": (
        "matplotlib",
        "recordings.report.print recordings.report.print",
        lambda path: command("diff", path, path, "--picture", path.with_suffix(".png")),
    ),
    "a scene": (
        "foxglove_schemas_protobuf",
        "recordings.export.scene",
        lambda path: command("scene", path, "-o", path.with_name("scene.mcap")),
    ),
    "a live view": (
        "foxglove",
        "",
        lambda path: command("replay", path, "--foxglove"),
    ),
    "tables to write": ("pyarrow", "recordings.export.parquet", exported),
    "a netCDF file": (
        "h5netcdf",
        "recordings.export.netcdf",
        lambda path: command("export", path, "--to", "nc", "-o", path.with_suffix(".nc")),
    ),
    "a table to read": ("pyarrow", "", lambda _path: file_columns(b"PAR1", "a.parquet")),
    "a URDF": ("casadi", "plant_fmu.bundled.rigid_body", lambda _: build_urdf(read_urdf(ARM))),
}
"""A package, our modules that import it as a whole if there are any, and what uses it."""


@pytest.mark.parametrize(("package", "modules", "use"), NEEDS.values(), ids=NEEDS.keys())
def test_a_missing_extra_says_what_to_install(tmp_path, monkeypatch, package, modules, use):
    path = tmp_path / "a.mcap"
    recorded(path, ticks=1)
    path.with_suffix(".parquet").touch()
    before = {entry.name for entry in tmp_path.iterdir()}
    if package == "foxglove_schemas_protobuf":
        monkeypatch.delitem(sys.modules, "nrs_cosim.recordings.export.scene", raising=False)
    for name in modules.split():
        monkeypatch.delitem(sys.modules, f"nrs_cosim.{name}", raising=False)
    for name in [name for name in sys.modules if name.startswith(f"{package}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError) as error:
        use(path)
    said = re.fullmatch(
        r".* (\S+), which is not installed: pip install '\.\[(\w+)\]' in nrs-cosim's sources",
        str(error.value),
    )
    named, extra = said[1], said[2]
    assert named.replace("-", "_").removesuffix("_sdk") == package
    brings = {re.split("[<>=]", requirement)[0] for requirement in EXTRAS[extra]}
    assert {named, "xarray"} & brings if named == "pandas" else named in brings
    assert {entry.name for entry in tmp_path.iterdir()} == before
