"""What theory says before a run: `check`, and its map of the spectral radius."""

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.option_rules import OptionRules
from nrs_cosim.orchestrator.cli.options import (
    Compile,
    NewScenario,
    ScenarioPath,
    Set,
    changes_of,
)
from nrs_cosim.orchestrator.exit_status import DONE, FAILED
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json, say


@OptionRules(
    {
        "--worst-target": ("--output",),
        "--output": ("--worst-target",),
        "--figure": ("--over",),
    },
    [("--over", other) for other in ("--worst-target", "--strict", "--compile")],
)
def check(
    scenario: ScenarioPath,
    as_json: AsJson = False,
    changes: Set = None,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="Exit with status 1 when a condition or convergence is violated or unknown.",
        ),
    ] = False,
    worst_target: Annotated[
        bool,
        typer.Option(
            "--worst-target",
            help="Write the scenario with the target, within gamma_1 and gamma_2, that attains the "
            "worst case: of linear agents that keep a position and a velocity, over sound links "
            "at constant periods. Run it, and measured / worst case is what is attained.",
        ),
    ] = False,
    output: NewScenario = None,
    compiling: Compile = False,
    over: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUES",
            help="An axis of a map of the spectral radius, as of nrs sweep; two are given, and no "
            "plant is opened.",
        ),
    ] = None,
    figure: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw the map, with the lines where errors stay as large: .png, .pdf or .svg.",
        ),
    ] = None,
) -> None:
    """Show what theory proves of a scenario, and whether its plants can be opened."""
    if over:
        from nrs_cosim.orchestrator.cli.map_text import show_map

        show_map(scenario, changes_of(changes), over, figure, as_json)
        return
    from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
    from nrs_cosim.orchestrator.analysis.conclusion import theory_json
    from nrs_cosim.orchestrator.analysis.conditions import check as theory_of
    from nrs_cosim.orchestrator.analysis.plant_samples import Sampling
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.orchestrator.cli.theory_text import unmet as unmet_of
    from nrs_cosim.orchestrator.engine.plants import (
        group_by_archive,
        naming_field,
        open_fleet,
        with_compiled_fmus,
    )
    from nrs_cosim.orchestrator.engine.scenario_warnings import scenario_warnings
    from nrs_cosim.orchestrator.engine.units import other_rates
    from nrs_cosim.orchestrator.scenario.file import read_scenario, scenario_name

    experiment = read_scenario(scenario, changes_of(changes))
    with stages(err) as begin:
        begin("opening the plants")
        with naming_field(scenario_name(scenario)), ExitStack() as stack:
            if compiling:
                experiment = with_compiled_fmus(experiment)
            groups = group_by_archive(experiment)
            fleet = open_fleet(stack, groups, experiment.bodies())
            drives = ((g.plant.fmu, p.drive) for g, p in zip(groups, fleet.plants, strict=True))
            for warning in (*scenario_warnings(experiment), *other_rates(drives)):
                say("yellow", "warning", warning)
        find = Sampling(experiment)
        begin("whether the estimates converge")
        checked = theory_of(experiment, find)
        begin("bounds of the steady state")
        ultimate = ultimate_bounds(experiment, checked.links.radius, find)
        for part in ultimate.stiff:
            say("yellow", "warning", part.sentence())
        if worst_target and output:
            from nrs_cosim.orchestrator.analysis.worst_scenario import worst_target_changes
            from nrs_cosim.orchestrator.cli.scenario_files import changed_text, write_scenario

            begin("the worst target")
            changed = worst_target_changes(experiment, ultimate)
            text = changed_text(experiment, changed, "--worst-target")
            head = [
                f"{quoted(experiment.name)} with the target of nrs check --worst-target, at which "
                "errors of the estimates come to the worst case within gamma_1 and gamma_2 near "
                "the end."
            ]
            write_scenario(output, experiment, text, head)
    if as_json:
        print_json(theory_json(checked, ultimate))
    else:
        summary_text.theory_table(out, checked, ultimate, bounds(ultimate))
    _end_strictly(unmet_of(checked, ultimate) if strict else [])


def _end_strictly(unmet: list[str]) -> None:
    """Exit with status 1 where something is violated or unknown, and say what."""
    for line in unmet:
        say("red", "strict", line)
    raise typer.Exit(FAILED if unmet else DONE)
