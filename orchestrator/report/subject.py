"""What a report must know of a scenario: target, network and theory."""

import re
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.orchestrator.analysis.bounds import bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.conditions import Check, check, finite
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.robot_ids import with_parameters
from nrs_cosim.orchestrator.scenario.tables.algorithms import NotInstalled
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState
from nrs_cosim.recordings.report.data import Story, read_story
from nrs_cosim.recordings.report.subject import Subject, unit_over
from nrs_cosim.recordings.schemas import about
from nrs_cosim.recordings.units import shared_joints


def story_of(reader: Reader, experiment: Experiment | None = None) -> Story:
    """Read what a report draws of a recording, of an experiment that may be known already."""
    run = about(reader).run
    unit = unit_over([joint.unit for group in run.plants for joint in group.joints])
    names = tuple(joint.name for joint in shared_joints(run))
    return read_story(reader, subject_of(experiment or experiment_of(reader), unit, names))


def subject_of(experiment: Experiment, unit: str, joints: Sequence[str] = ()) -> Subject:
    """Return what a report must know of an experiment, whose joints are in a unit, with names."""
    choice = experiment.scenario.algorithm
    # Nothing is proven of an algorithm that is not installed: its recording is drawn all the same.
    checked = None if isinstance(choice, NotInstalled) else check(experiment)
    return Subject(
        estimator=with_parameters(choice.name, choice.parameters),
        times=experiment.clock,
        pace=_pace(experiment.clock),
        target_at=experiment.target_at,
        topology=experiment.topologies.links,
        phases=_phases(experiment.topologies),
        unit=unit,
        joints=[_joint(number, joints) for number in range(1, experiment.m + 1)],
        conditions=_condition_rows(checked) if checked else [],
        spectral_radius=None
        if checked is None or checked.premise
        else finite(checked.spectral_radius),
        byzantine=experiment.byzantine,
        bounds=_bounds(experiment, checked) if checked else {},
    )


def _joint(number: int, names: Sequence[str]) -> str:
    """Return what a joint is called; by its number where its FMU has no better name for it."""
    name = names[number - 1] if names else ""
    return f"joint {number}" if re.fullmatch(r"(q\[\d+\])?", name) else name


def _pace(clock: Clock) -> str:
    if clock.period is not None:
        return f"every {seconds(clock.period):g} s"
    if clock.jitter:
        early = f"up to {seconds(clock.jitter.most):g} s early, drawn from the seed"
        return f"every {seconds(clock.cycle):g} s, each {early},"
    return f"{seconds(clock.shortest):g} to {seconds(clock.longest):g} s after one another"


def _phases(topologies: TopologySchedule) -> str:
    """Say when the links are there that there are at some time; nothing where that is always."""
    count, ticks = len(topologies.exchanges), topologies.repeat
    sentences = []
    if count > 1:
        end = f"again after {ticks} ticks" if ticks else "and the last stays"
        sentences.append(f"{count} phases of the network, {end}")
    if any(exchange.has_two_digraphs for exchange in topologies.exchanges):
        sentences.append("positions and velocities travel over digraphs of their own")
    words = "; ".join(sentences)
    return words and f"{words[0].upper()}{words[1:]}: these are all links of them."


def _bounds(experiment: Experiment, checked: Check) -> dict[str, dict[str, float]]:
    """Return the theory's bounds on each steady-state error, by their names."""
    found = bounds(ultimate_bounds(experiment, checked.rho))
    names = [field.name for field in fields(SteadyState)]
    by_quantity = {
        name: {
            "steady state": bound.steady_state,
            "worst case": bound.worst_case,
            "paper": bound.paper,
        }
        for name, bound in zip(names, found, strict=False)
    }
    return {
        name: {law: value for law, value in by_law.items() if value is not None}
        for name, by_law in by_quantity.items()
    }


def _condition_rows(checked: Check) -> list[dict[str, Any]]:
    of = f", of {checked.premise}" if checked.premise else ""
    return [
        {
            "name": c.name,
            "value": c.value,
            "bound": finite(c.bound),
            "at_least": c.at_least,
            "status": checked.status(c),
            "source": c.source + of * (not c.of_liars),
        }
        for c in checked.conditions
    ]
