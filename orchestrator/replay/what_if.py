"""What if a plant, a controller or a gain had been another? A recording's run, changed a little.

Estimates do not depend on plants: when plants alone are changed, the traffic stays as recorded, and
only the robots that were changed are run again, the others are as they were. When the algorithm is
changed, the agents start again from the recorded estimates, receive the recorded target, and all
else follows.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.transport import Bus
from nrs_cosim.orchestrator.engine.attachments import with_allowed_fmus
from nrs_cosim.orchestrator.engine.in_process import on_a_session
from nrs_cosim.orchestrator.engine.lockstep import Launcher, Workers
from nrs_cosim.orchestrator.engine.plants import (
    Find,
    find_recorded,
    group_by_archive,
    with_compiled_fmus,
)
from nrs_cosim.orchestrator.engine.robots import Robots
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.engine.worker import Watch
from nrs_cosim.orchestrator.replay.verify import RecordedPlants, expect_states, states_of
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import changed
from nrs_cosim.plant_fmu.fleet import Fleet
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import PARENT
from nrs_cosim.recordings.schemas import about


def changed_run(
    reader: Reader,
    plants: Sequence[Change],
    algorithms: Sequence[Change],
    *,
    allow_fmus: bool = False,
    compiling: bool = False,
) -> tuple[Experiment, Launcher | None, dict[str, dict[str, str]]]:
    """Return the changed experiment, how its run gets its robots, and the metadata that say so.

    With no algorithm changed the plants alone are run again; else all is. FMUs that the recording
    holds are run where they are allowed. `InputError` names what is wrong with a change, or says
    that the recording is not complete.
    """
    if reader.status != "completed" or reader.damage:
        raise InputError(f"{reader.path}: is {reader.status}: let `nrs resume` complete it first")
    changes = [change.of_plants() for change in plants]
    changes += [change.within("algorithm") for change in algorithms]
    recorded = experiment_of(reader)
    try:
        experiment = changed(recorded, changes)
    except InputError:
        recorded.scenario.algorithm.loaded()  # it says which package it was of, if it is not here
        raise
    if allow_fmus:
        experiment = with_allowed_fmus(experiment)
    if compiling:
        experiment = with_compiled_fmus(experiment)
    if algorithms:
        group_by_archive(experiment, find=finder(reader, experiment))
    every = tuple(range(1, experiment.n + 1))
    robots = {robot for change in plants for robot in change.robots or every}
    launch = None if algorithms else run_again(reader, experiment, sorted(robots))
    return experiment, launch, parent(reader, [*plants, *algorithms])


def run_again(reader: Reader, experiment: Experiment, robots: Sequence[int]) -> Launcher:
    """Return how a run gets the plants of some robots, and those of all others as recorded."""
    n, m = experiment.n, experiment.m
    every = range(1, n + 1)
    others = [robot for robot in every if robot not in set(robots)]

    def launch(stack: ExitStack, watch: Watch) -> tuple[Bus, Workers]:
        real = Robots.opened(stack, experiment, robots, finder(reader, experiment))
        parts: list[Any] = [(np.array(robots) - 1, real.plants)]
        if others:
            expect_states(reader, experiment.clock, n)
            rest = RecordedPlants(others, m, states_of(reader))
            parts.append((np.array(others) - 1, rest))
        descriptions = [*real.plant_descriptions, *_descriptions_of(reader, others)]
        fleet = Fleet(parts, m)
        return on_a_session(stack, Robots.driven_by(experiment, every, fleet, descriptions), watch)

    return launch


def finder(reader: Reader, experiment: Experiment) -> Find:
    """Return what finds the FMUs of a changed scenario: the recorded ones, and those it brings."""
    return find_recorded(about(reader).plants, experiment, others=True)


def parent(reader: Reader, changes: Sequence[Change]) -> dict[str, dict[str, str]]:
    """Return the metadata that names the recording from which another came."""
    text = "; ".join(f"{change.option} {change.text}" for change in changes)
    return {PARENT: {"digest": reader.digest_here, "change": text}}


def _descriptions_of(reader: Reader, robots: Sequence[int]) -> list[dict[str, Any]]:
    """Return what a recording tells of some robots' plants, by group."""
    descriptions, said = [], about(reader)
    for group in said.plants:
        mine = [robot for robot in group["robots"] if robot in set(robots)]
        if mine:
            urdf = said.urdfs.get(mine[0], b"").decode()
            descriptions.append({**group, "robots": mine, "urdf": urdf})
    return descriptions
