"""`nrs check --over`: the spectral radius over two axes, as JSON, as marks, and as a figure."""

from collections.abc import Sequence
from pathlib import Path

from nrs_cosim.orchestrator.cli.formats import format_of
from nrs_cosim.orchestrator.cli.report_files import write_radius_map
from nrs_cosim.orchestrator.cli.tables import grid
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.orchestrator.study.radius_map import radius_map
from nrs_cosim.orchestrator.terminal import out, print_json


def show_map(
    scenario: Path,
    changes: Sequence[Change],
    over: Sequence[str],
    figure: Path | None,
    as_json: bool,
) -> None:
    """Show the map, and draw it where a figure is asked for."""
    kind = format_of(figure, None, ("png", "pdf", "svg"), "--figure") if figure else ""
    made = radius_map(read_scenario(scenario, changes), over)
    if figure:
        write_radius_map(made, figure, kind)
    if as_json:
        print_json(made.as_json())
    else:
        grid(out, made.lines())
