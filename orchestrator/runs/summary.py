"""What a recording says of its run, in few words and as JSON."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bus.text import storable
from orchestrator.scenario.clock import NS_PER_S
from orchestrator.scenario.file import ScenarioFile, parse_scenario
from orchestrator.scenario.setting import target_of
from recordings.measuring import Array, SteadyState, steady_state
from recordings.reading import Reader
from recordings.tables import REFUSED, SCENARIO, SPENT
from recordings.tables import about as about_run

_PARTIAL = "none of the run: messages of it are missing here"
PARENT = "nrs.parent"
"""The metadata record of a recording that came from another by a change."""


def describe(reader: Reader) -> dict[str, Any]:
    """Return what a recording says of itself, for JSON; `duration` is simulated time in s."""
    about, scenario = about_run(reader), scenario_text(reader)
    return {
        "file": storable(str(reader.path)),
        "name": about["name"],
        "status": reader.status,
        "reason": reader.reason,
        "digest": reader.digest,
        "digest_here": reader.digest_here,
        "ticks": reader.ticks,
        "ticks_planned": int(about["ticks"]),
        "robots": int(about["robots"]),
        "joints": int(about["joints"]),
        "messages": reader.message_count,
        "duration": _duration(reader, about.get("sampling_period_ns")),
        "seed": int(about["seed"]),
        "plants": json.loads(about["plants"]),
        "target": _target(scenario),
        "versions": reader.metadata["nrs.versions"],
        "damage": reader.damage,
        "parent": reader.metadata.get(PARENT),
        "spent": json.loads(reader.end.get(SPENT, "null")),
        "refused": json.loads(reader.end.get(REFUSED, "{}")),
        "scenario": scenario,
    }


def _target(scenario: str) -> dict[str, str] | None:
    """Return which FMU was the target, where one was."""
    if "sha256" not in scenario:
        return None
    told = tomllib.loads(scenario)["target"]
    return {name: told[name] for name in ("fmu", "sha256")} if told.get("kind") == "fmu" else None


def _duration(reader: Reader, period_ns: str | None) -> float:
    """Return the simulated time of all ticks, s; of aperiodic ones, when the last one was."""
    return (reader.ticks * int(period_ns) if period_ns else reader.end_ns or 0) / NS_PER_S


def lines(told: Mapping[str, Any], measured: SteadyState) -> dict[str, str]:
    """Return a run's summary as short lines by name."""
    plants = (
        f"{plant['fmu']} (FMI {plant['fmi_version']}, {plant['drive']}, "
        f"{len(plant['robots'])} robot{'s' * (len(plant['robots']) > 1)})"
        for plant in told["plants"]
    )
    parent, target = told["parent"], told["target"]
    led = {"target": f"{target['fmu']}, SHA-256 {target['sha256']}"} if target else {}
    of = {"parent": f"{parent['digest']}, changed by {parent['change']}"} if parent else {}
    return {
        "run": told["name"] + ": " + ", ".join(filter(None, (told["status"], told["reason"]))),
        "robots": f"{told['robots']}, {told['joints']} axes each",
        "plants": "; ".join(plants),
        "driven": _driven(told["plants"]),
        **led,
        "ticks": f"{told['ticks']} of {told['ticks_planned']}, t = {told['duration']:g} s",
        "messages": f"{told['messages']}",
        "estimates": _suprema(
            ("eps - eps_0|inf", measured.position_estimate),
            ("ups - ups_0|inf", measured.velocity_estimate),
        ),
        "tracking": _suprema(
            ("q - eps_0|2", measured.position_tracking),
            ("qd - ups_0|2", measured.velocity_tracking),
        ),
        **of,
        "digest": told["digest"] or _PARTIAL,
        "recording": told["file"],
    }


def _suprema(*found: tuple[str, float | None]) -> str:
    """Say how large errors were in the last fifth, where any was measured."""
    known = [f"sup |{name} = {value:.4g}" for name, value in found if value is not None]
    return ", ".join([*known, "in the last fifth"]) if known else "not measured: no tick is here"


def _driven(plants: Sequence[Mapping[str, Any]]) -> str:
    """Say how plants are driven, and which FMUs where they are not all driven alike."""
    fmus: dict[str, list[str]] = {}
    for plant in plants:
        fmus.setdefault(plant["why"], []).append(plant["fmu"])
    if len(fmus) == 1:
        return next(iter(fmus))
    return "; ".join(f"{', '.join(dict.fromkeys(who))}: {why}" for why, who in fmus.items())


def scenario_text(reader: Reader) -> str:
    """Return the text of the scenario that a recording came from."""
    return reader.attachments[SCENARIO][1].decode()


def scenario_of(reader: Reader) -> ScenarioFile:
    """Return the scenario that a recording came from; its paths are relative to where it was."""
    about = about_run(reader)
    return parse_scenario(scenario_text(reader), about["name"], Path(about["folder"]), SCENARIO)


def measure(reader: Reader) -> SteadyState:
    """Return the steady-state errors of a recording, against its scenario's target."""
    target = target_of(scenario_of(reader).scenario)

    def at(seconds: Array) -> tuple[Array, Array]:
        motion = target.at(seconds)
        return motion.position, motion.velocity

    return steady_state(reader, at)
