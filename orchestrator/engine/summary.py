"""What a recording says of its run, in few words and as JSON."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.plurals import count_of, numbered
from nrs_cosim.bus.text import storable
from nrs_cosim.orchestrator.engine.link_summary import links_line, links_of
from nrs_cosim.orchestrator.scenario.assets import Asset
from nrs_cosim.orchestrator.scenario.conversion import control
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.orchestrator.scenario.robot_ids import with_parameters
from nrs_cosim.orchestrator.scenario.tables.targets import FmuMotion
from nrs_cosim.plant_fmu.urdf_limits import effort_limits
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.container import END
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import (
    Array,
    SteadyState,
    saturation,
    saturation_in_words,
    steady_state,
)
from nrs_cosim.recordings.metadata import ASSETS, MEASURED, RUN, SCENARIO
from nrs_cosim.recordings.schemas import about as about_run
from nrs_cosim.recordings.schemas import expect_joints, recorded_types
from nrs_cosim.recordings.units import joint_names, unit_over

_PARTIAL = "none of the run: messages of it are missing here"


def describe(reader: Reader, experiment: Experiment) -> dict[str, Any]:
    """Return what an experiment's recording says of itself, for JSON; `duration` is simulated."""
    about = about_run(reader)
    run, ending, chosen = about.run, reader.ending, experiment.scenario.algorithm
    duration = _duration(reader, run.sampling_period_ns)
    return {
        "file": storable(str(reader.path)),
        "name": run.name,
        "status": reader.status,
        "reason": reader.reason,
        "cause": asdict(ending.cause) if ending and ending.cause else None,
        "digest": reader.digest,
        "digest_here": reader.digest_here,
        "ticks": reader.ticks,
        "ticks_planned": run.ticks,
        "robots": run.robots,
        "joints": run.joints,
        "messages": reader.message_count,
        "samples": _samples(reader, run.robots, duration),
        "duration": duration,
        "seed": run.seed,
        "byzantine": experiment.byzantine,
        "algorithm": {"name": chosen.name, "parameters": chosen.parameters},
        "plants": about.plants,
        "target": _target(experiment),
        "assets": {
            field: asset.model_dump(include={"name", "sha256", "source_sha256"})
            for field, asset in about.assets.items()
        },
        "measured": "stored" if stored_measurement(reader, experiment) else "from messages",
        "links": links_of(reader, experiment),
        "saturation": _saturation(reader, experiment),
        "versions": dict(about.versions),
        "damage": reader.damage,
        "parent": about.parent.model_dump() if about.parent else None,
        "spent": ending.spent if ending else None,
        "rejected": (ending and ending.rejected) or {},
        "scenario": about.scenario,
    }


def _target(experiment: Experiment) -> dict[str, str] | None:
    """Return which FMU was the target, where one was."""
    target = experiment.scenario.target
    if not isinstance(target, FmuMotion):
        return None
    return {"fmu": target.fmu, "sha256": target.sha256}


def _saturation(reader: Reader, experiment: Experiment) -> dict[str, list[float]] | None:
    """Return in which part of its states each robot's torques are at their limits, by joint."""
    limits = torque_limits(reader, experiment)
    if not limits:
        return None
    return {str(robot): at.tolist() for robot, at in saturation(reader, limits).items()}


def torque_limits(reader: Reader, experiment: Experiment) -> dict[int, Array]:
    """Return the limits of torques, (m,) by joint, of each robot that has any."""
    limits, joints = {}, {r: p["joints"] for p in about_run(reader).plants for r in p["robots"]}
    for robot in range(1, experiment.n + 1):
        wanted = control(experiment.of_robot(robot).controller, experiment.m)
        limit = wanted.torque_limit
        if wanted.limited_by_effort:
            urdf = about_run(reader).urdfs.get(robot, b"").decode(errors="replace")
            with suppress(ValueError):  # of a recording that has lost its URDF nothing is known
                limit = effort_limits(urdf, [joint["name"] for joint in joints.get(robot, ())])
        if limit is not None:
            limits[robot] = limit
    return limits


def _samples(reader: Reader, n: int, duration: float) -> dict[str, float] | None:
    """Return how many samples the robots sent, and how many each a second; None if not known."""
    if reader.ending is None or reader.ending.samples is None or not duration:
        return None
    count = reader.ending.samples
    return {"count": count, "per_robot_and_second": count / (n * duration)}


def _duration(reader: Reader, period_ns: int | None) -> float:
    """Return the simulated time of all ticks, s; of aperiodic ones, when the last one was."""
    return (reader.ticks * period_ns if period_ns else reader.end_ns or 0) / NS_PER_S


def lines(summary: Mapping[str, Any], measured: SteadyState) -> dict[str, str]:
    """Return a run's summary as short lines by name."""
    plants = (
        f"{plant['fmu']} (FMI {plant['fmi_version']}, {plant['drive']}, "
        f"{count_of(len(plant['robots']), 'robot')})"
        for plant in summary["plants"]
    )
    parent, target = summary["parent"], summary["target"]
    unit = unit_over({joint["unit"] for plant in summary["plants"] for joint in plant["joints"]})
    mixed = f" ({unit})" * (" and " in unit)
    led = {"target": f"{target['fmu']}, SHA-256 {target['sha256']}"} if target else {}
    of = {"parent": f"{parent['digest']}, changed by {parent['change']}"} if parent else {}
    return {
        "run": summary["name"]
        + ": "
        + ", ".join(filter(None, (summary["status"], summary["reason"]))),
        "robots": f"{summary['robots']}, {summary['joints']} axes each",
        **({"byzantine": _byzantine(summary["byzantine"])} if summary["byzantine"] else {}),
        "algorithm": with_parameters(**summary["algorithm"]),
        "plants": "; ".join(plants),
        "driven": _driven(summary["plants"]),
        **led,
        **({"assets": _assets(summary["assets"])} if summary["assets"] else {}),
        "ticks": f"{summary['ticks']} of {summary['ticks_planned']}, t = {summary['duration']:g} s",
        "messages": f"{summary['messages']}{_sent(summary['samples'])}",
        **({"links": links_line(summary["links"])} if summary["links"] else {}),
        "estimates": _suprema(
            mixed,
            ("eps - eps_0|inf", measured.position_estimate),
            ("ups - ups_0|inf", measured.velocity_estimate),
        ),
        "tracking": _suprema(
            mixed,
            ("q - eps_0|2", measured.position_tracking),
            ("qd - ups_0|2", measured.velocity_tracking),
        ),
        **_limited(summary["saturation"], summary["plants"], summary["joints"]),
        **of,
        "digest": summary["digest"] or _PARTIAL,
        "recording": summary["file"],
    }


def _limited(
    saturation: Mapping[str, Sequence[float]] | None, plants: Sequence[Mapping[str, Any]], m: int
) -> dict[str, str]:
    """Say how often torques are at their limits, where there are any."""
    if saturation is None:
        return {}
    of = {int(robot): at for robot, at in saturation.items()}
    each = {tuple(joint["name"] for joint in plant["joints"]) for plant in plants}
    names = each.pop() if len(each) == 1 else ()
    return {"limits": saturation_in_words(of, joint_names(names, m))}


def _sent(samples: Mapping[str, float] | None) -> str:
    """Say how much robots sent, where that is known."""
    if samples is None:
        return ""
    return f", with {samples['per_robot_and_second']:.4g} samples of each robot a second"


def _byzantine(robots: Sequence[int]) -> str:
    lie = f"lie{'s' * (len(robots) == 1)}"
    return f"{numbered('robot', robots, 8)} {lie}; errors and bounds are of the honest robots"


def _assets(assets: Mapping[str, Mapping[str, str]]) -> str:
    """Say which files the scenario names, and what of them is in the recording."""
    return "; ".join(
        f"{field} {asset['name']}, SHA-256 {asset['sha256']}" for field, asset in assets.items()
    )


def _suprema(mixed: str, *found: tuple[str, float | None]) -> str:
    """Say how large errors were in the last fifth, where any was measured, over units if mixed."""
    known = [f"sup |{name} = {value:.4g}" for name, value in found if value is not None]
    return (
        ", ".join([*known, f"in the last fifth{mixed}"])
        if known
        else "not measured: no tick is here"
    )


def _driven(plants: Sequence[Mapping[str, Any]]) -> str:
    """Say how plants are driven, and which FMUs where they are not all driven alike."""
    fmus: dict[str, list[str]] = {}
    for plant in plants:
        fmus.setdefault(plant["why"], []).append(plant["fmu"])
    if len(fmus) == 1:
        return next(iter(fmus))
    return "; ".join(f"{', '.join(dict.fromkeys(who))}: {why}" for why, who in fmus.items())


def experiment_of(reader: Reader) -> Experiment:
    """Return the experiment that a recording is of; its paths begin where the recording says."""
    about = about_run(reader)
    run = about.run
    origin = f"{reader.path}: {SCENARIO}"
    assets = {
        field: Asset.of(record.name, record.source_sha256, *reader.attachments[record.attachment])
        for field, record in about.assets.items()
    }
    folder = Path(reader.path).parent / run.folder
    experiment = parse_scenario(
        about.scenario, run.name, folder, origin, assets, recorded=about.versions
    )
    if unnamed := assets.keys() - experiment.assets.keys():
        raise UnreadableError(f"{origin}: names no {min(unnamed)}, of which {ASSETS} has an asset")
    for key, number in told_of(experiment).items():
        if getattr(run, key) != number:
            raise UnreadableError(
                f"{origin}: has {key} = {number}, but {RUN} has {getattr(run, key)}"
            )
    expect_joints(reader, recorded_types(reader))
    if reader.digest and reader.end_ns not in {experiment.clock.t(reader.ticks), None}:
        raise UnreadableError(
            f"{reader.path}: {END}: ticks: is {reader.ticks}, but the last message is of "
            f"t = {reader.end_ns} ns"
        )
    return experiment


def told_of(experiment: Experiment) -> dict[str, int]:
    """Return the numbers of an experiment that its recording tells, times in ns."""
    clock = experiment.clock
    plan = {"seed": experiment.seed, "robots": experiment.n, "joints": experiment.m}
    plan["ticks"] = clock.ticks
    if clock.period is None:  # each message has its time
        return plan | {"outputs_per_interval": clock.parts}
    step = clock.period // clock.parts
    return plan | {"sampling_period_ns": clock.period, "output_step_ns": step}


def measure(reader: Reader, experiment: Experiment) -> SteadyState:
    """Return the steady-state errors of a recording, of its honest robots against its target.

    Those that its run has stored are taken where the checksums vouch for the file.
    """
    if stored := stored_measurement(reader, experiment):
        return stored
    return steady_state(reader, experiment.target_at, experiment.byzantine)


def stored_measurement(reader: Reader, experiment: Experiment) -> SteadyState | None:
    """Return what a run measured of itself; None where it is not known, or is to be computed."""
    found = reader.ending.measured if reader.ending and not reader.computed else None
    if found is None or experiment.text != about_run(reader).scenario:
        return None
    if max(found.times_ns) > (reader.end_ns or 0):
        raise UnreadableError(
            f"{reader.path}: {END}: {MEASURED}: times_ns: expected none after the last message, at "
            f"{reader.end_ns} ns, got {max(found.times_ns)}"
        )
    return SteadyState(**{name: getattr(found, name) for name in type(found).model_fields})


def wrong_measurement(reader: Reader, measured: SteadyState) -> str:
    """Say that what was stored of a whole run is not what its messages give, where it is not."""
    stored = reader.ending.measured if reader.ending and reader.digest else None
    if stored is None or stored.model_dump() == asdict(measured):
        return ""
    return f"{END}: {MEASURED}: is not what the messages give"
