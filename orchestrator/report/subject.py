"""What a report must know of a scenario: target, network and theory."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any
from zlib import crc32

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.conditions import Check, check, finite
from nrs_cosim.orchestrator.engine.link_summary import links_line, links_of
from nrs_cosim.orchestrator.engine.summary import experiment_of, torque_limits
from nrs_cosim.orchestrator.report.gain_map import gain_map
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.robot_ids import named, with_parameters
from nrs_cosim.orchestrator.scenario.tables.algorithms import NotInstalled
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import QUANTITIES
from nrs_cosim.recordings.metadata import RunRecord
from nrs_cosim.recordings.report.data import Story, read_story
from nrs_cosim.recordings.report.subject import Subject
from nrs_cosim.recordings.schemas import about
from nrs_cosim.recordings.units import joint_names, shared_joints, unit_over


def story_of(reader: Reader, experiment: Experiment | None = None) -> Story:
    """Read what a report draws of a recording, of an experiment that may be known already."""
    run = about(reader).run
    experiment = experiment or experiment_of(reader)
    units = [
        unit_over([joint.unit for group in run.plants for joint in group.joints[at : at + 1]])
        for at in range(run.joints)
    ]
    names = tuple(joint.name for joint in shared_joints(run))
    theory = _theory(experiment)
    subject = subject_of(experiment, units, names, theory)
    links = links_of(reader, experiment)
    subject = replace(
        subject,
        plants=_plants(experiment, run),
        links=links_line(links) if links else "",
        torque_limits=torque_limits(reader, experiment),
    )
    story = read_story(reader, subject)
    if not theory:
        return story
    compared = compare_to_theory(reader, experiment, story.steady, theory[1])
    rows = zip(QUANTITIES, compared.quantities, strict=True)
    return replace(story, verdicts={name: row.status for name, row in rows})


def _theory(experiment: Experiment) -> tuple[Check, UltimateBounds] | None:
    """Return what is proven; nothing of an algorithm that is not installed here."""
    if isinstance(experiment.scenario.algorithm, NotInstalled):
        return None
    checked = check(experiment)
    return checked, ultimate_bounds(experiment, checked.links.radius)


def subject_of(
    experiment: Experiment,
    units: Sequence[str],
    joints: Sequence[str] = (),
    theory: tuple[Check, UltimateBounds] | None = None,
) -> Subject:
    """Return what a report must know of an experiment, whose joints have units, and names."""
    checked, ultimate = theory or _theory(experiment) or (None, None)
    choice = experiment.scenario.algorithm
    no_theory = str(choice.why_not()) if isinstance(choice, NotInstalled) else ""
    return Subject(
        estimator=with_parameters(choice.name, choice.parameters),
        times=experiment.clock,
        pace=_pace(experiment.clock),
        target_at=experiment.target_at,
        topologies=experiment.topologies,
        phases=_phases(experiment.topologies),
        units=units,
        joints=joint_names(joints, experiment.m),
        conditions=_condition_rows(checked) if checked else [],
        spectral_radius=None
        if checked is None or checked.links.loss  # no run falls by a mean-square radius
        else finite(checked.spectral_radius),
        byzantine=experiment.byzantine,
        bounds=_bounds(ultimate) if ultimate else {},
        settings=_settings(experiment),
        gains=gain_map(experiment, checked) if checked else None,
        no_theory=no_theory,
    )


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


def _bounds(ultimate: UltimateBounds) -> dict[str, dict[str, float]]:
    """Return the theory's bounds on each steady-state error, by their names."""
    by_quantity = {
        name: {
            "steady state": bound.steady_state,
            "worst case": bound.worst_case,
            "paper": bound.paper,
        }
        for name, bound in zip(QUANTITIES, bounds(ultimate), strict=False)
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


def _plants(experiment: Experiment, run: RunRecord) -> list[dict[str, str]]:
    """Return a row for robots of the same FMU, parameters and controller."""
    rows = []
    for group in run.plants:
        alike: dict[tuple[str, str], list[int]] = {}
        for robot in group.robots:
            own = experiment.of_robot(robot)
            law = own.controller.model_dump(mode="json", exclude_none=True, exclude_defaults=True)
            given = _values(sorted(own.plant.parameters.items())), _values(law.items())
            alike.setdefault(given, []).append(robot)
        joints = ", ".join(f"{joint.name} ({joint.unit or '?'})" for joint in group.joints)
        rows += [
            {
                "robots": named(robots),
                "FMU": group.fmu,
                "FMI": group.fmi_version,
                "driven by": group.drive,
                "parameters": parameters or "as in the FMU",
                "controller": law or "none",
                "joints": joints,
                "SHA-256": group.sha256,
            }
            for (parameters, law), robots in alike.items()
        ]
    return rows


def _values(given: Iterable[tuple[str, Any]]) -> str:
    return ", ".join(f"{name} = {_short(value)}" for name, value in given)


def _settings(experiment: Experiment) -> dict[str, str]:
    """Return the keys of a scenario with their values, in words; a file is what it holds."""
    tables = experiment.scenario.model_dump(mode="json", by_alias=True)
    files = {
        field: f"{asset.name} ({asset.source_sha256[:8]})"
        for field, asset in experiment.assets.items()
    }
    return {key: _short(value) for key, value in _leaves("", tables)} | files


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(f"{key}.{name}" if key else str(name), inner)
    elif isinstance(value, list) and any(isinstance(inner, Mapping) for inner in value):
        for number, inner in enumerate(value):
            yield from _leaves(f"{key}[{number}]", inner)
    else:
        yield key, value


_SHORT = 60


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    if len(text) <= _SHORT:
        return text
    return f"{text[:_SHORT]}… ({crc32(text.encode()):08x})"
