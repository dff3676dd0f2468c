"""`nrs design`: the scenario that is best in one way, with what theory says of it."""

from decimal import ROUND_CEILING, Context
from typing import TYPE_CHECKING, Annotated

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.option_rules import OptionRules
from nrs_cosim.orchestrator.cli.options import (
    NewScenario,
    ScenarioPath,
    Set,
    changes_of,
    number,
    whole_number,
)
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json, say

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds
    from nrs_cosim.orchestrator.analysis.designs import ScenarioDesign
    from nrs_cosim.orchestrator.analysis.plant_samples import Sampling
    from nrs_cosim.orchestrator.scenario.experiment import Experiment


@OptionRules(
    {"--share": ("--accuracy",)},
    one_of=[("--fastest",), ("--period",), ("--jitter",), ("--pin",), ("--accuracy",)],
)
def design(
    scenario: ScenarioPath,
    *,
    fastest: Annotated[
        bool,
        typer.Option("--fastest", help="Gains alpha and beta of the least spectral radius."),
    ] = False,
    period: Annotated[
        bool, typer.Option("--period", help="The longest sampling period that converges.")
    ] = False,
    jitter: Annotated[
        bool,
        typer.Option("--jitter", help="The largest jitter under which convergence is proven."),
    ] = False,
    pin: Annotated[
        int | None,
        typer.Option(
            metavar="K",
            parser=whole_number("--pin", 1),
            help="The K robots to receive from the target for the least spectral radius.",
        ),
    ] = None,
    accuracy: Annotated[
        tuple[str, str] | None,
        typer.Option(
            metavar="POSITION VELOCITY",
            help="Gains and a period proven to give tracking errors of so many rad and rad/s.",
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(
            metavar="PART",
            parser=number("--share"),
            help="Of --accuracy, the part that a robot may be off its own estimate of the target; "
            "the rest is for that estimate's error. A fraction above 0 and below 1: the larger, "
            "the lower the gains, and the shorter the period.",
        ),
    ] = 0.5,
    output: NewScenario = None,
    as_json: AsJson = False,
    changes: Set = None,
) -> None:
    """Find the gains, period, jitter or pinned robots that are best, and check the result."""
    errors = tuple(map(number("--accuracy"), accuracy or ()))
    if min(errors, default=1) <= 0:
        raise InputError(f"--accuracy: expected two numbers above 0, got {min(errors):g}")
    if not 0 < share < 1:
        raise InputError(f"--share: expected a number between 0 and 1, got {share:g}")
    from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
    from nrs_cosim.orchestrator.analysis import designs
    from nrs_cosim.orchestrator.analysis.plant_samples import Sampling
    from nrs_cosim.orchestrator.cli.progress import stages
    from nrs_cosim.orchestrator.scenario.file import read_scenario

    experiment = read_scenario(scenario, changes_of(changes))
    with stages(err) as begin:
        find = Sampling(experiment)
        begin("the design")
        if fastest:
            found = designs.fastest(experiment)
        elif period:
            found = designs.longest_period(experiment)
        elif jitter:
            found = designs.largest_jitter(experiment)
        elif pin is not None:
            found = designs.best_pinning(experiment, pin)
        else:
            found = designs.accurate(experiment, EstimateBounds(*errors), share, find)
    _show(experiment, found, find, as_json=as_json, output=output)


def _show(
    experiment: "Experiment",
    found: "ScenarioDesign",
    find: "Sampling",
    *,
    as_json: bool,
    output: NewScenario,
) -> None:
    """Show a design and the check of the scenario that it makes, which is written where asked."""
    from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
    from nrs_cosim.orchestrator.analysis.conclusion import conclusion, theory_json
    from nrs_cosim.orchestrator.analysis.conditions import check
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.conclusion_text import conclusion_sentence
    from nrs_cosim.orchestrator.cli.scenario_files import changed_text, write_scenario
    from nrs_cosim.orchestrator.cli.tables import grid
    from nrs_cosim.orchestrator.engine.recording_size import large_recording
    from nrs_cosim.orchestrator.scenario.file import resolve_scenario

    if output is not None and not found.changes:
        raise InputError(f"-o {output}: nothing is found that would be written")
    text = changed_text(experiment, found.changes, "design")
    name = experiment.name
    changed = resolve_scenario(text, name, experiment.folder, name, experiment.assets)
    if large := large_recording(changed):
        say("yellow", "warning", large)
    checked = check(changed, find)
    ultimate = ultimate_bounds(changed, checked.links.radius, find)
    if output is not None:
        rows = found.rows | _kept(found, ultimate)
        said = [f"{quoted(name)}, changed by nrs design:", *(f"{k}: {v}" for k, v in rows.items())]
        sentence = conclusion_sentence(conclusion(checked, ultimate))
        write_scenario(output, experiment, text, [*said, sentence])
    if as_json:
        print_json(
            {
                "goal": found.goal,
                "design": found.values,
                "changes": found.changes,
                "check": theory_json(checked, ultimate),
            }
        )
        return
    where = str(output) if output else "not written; -o NEW.toml writes it"
    grid(out, found.rows | {"scenario": where if found.changes else "unchanged"})
    out.print()
    summary_text.theory_table(out, checked, ultimate, bounds(ultimate))


def _kept(found: "ScenarioDesign", ultimate: "UltimateBounds") -> dict[str, str]:
    """Return a line of the accuracy that is proven of what is written, where one was asked for."""
    kept = ultimate.tracking.worst_case
    if found.goal != "accuracy" or kept is None:
        return {}
    up = Context(prec=4, rounding=ROUND_CEILING).create_decimal_from_float
    said = f"|q - eps_0|2 <= {up(kept.position):g}, |qd - ups_0|2 <= {up(kept.velocity):g}"
    any_target = f"|ups_0|inf <= {ultimate.gamma_1:.4g}, |a_0|inf <= {ultimate.gamma_2:.4g}"
    how = "as far as P3 was sampled" if ultimate.sampled else "proven"
    return {"kept": f"in steady state {said} for any target of {any_target} ({how})"}
