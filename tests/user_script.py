"""A user's program with every public name, which type checkers read strictly and Python runs."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

import nrs_cosim as nrs


@dataclass(frozen=True)
class Damped(nrs.Algorithm):
    """An algorithm as a user writes one."""

    alpha: float = nrs.parameter("gain on the positions", 0.9, above=0)

    def jump(self, estimate: nrs.Estimate, disagreement: nrs.Disagreement) -> nrs.Estimate:
        """Return the estimate right after t_k."""
        return nrs.Estimate(
            estimate.position + self.alpha * disagreement.position, 0.99 * estimate.velocity
        )


@dataclass(frozen=True)
class Falling(Damped):
    """One that keeps more than an estimate, and moves on a curve."""

    STATE: ClassVar[Mapping[str, nrs.Field]] = {
        **nrs.Algorithm.STATE,
        "pull": nrs.Field(unit="rad/s^2", doc="by which the estimate falls"),
    }

    def flow(self, x: nrs.Values, dt: float) -> nrs.Values:
        """Return the state a time later."""
        position = x.position + dt * (x.velocity + dt / 2 * x.pull)
        return x.replace(position=position, velocity=x.velocity + dt * x.pull)


def largest(recording: nrs.Recording) -> float:
    """Return the largest error of an estimated position."""
    return float(np.abs(recording.errors(robots=[1, 2])["position_estimate"]).max())


def theory_of(scenario: nrs.Scenario) -> dict[str, float | None]:
    """Return the bounds by quantity, and the margins by condition."""
    theory: nrs.Theory = nrs.check(scenario)
    assert theory.spectral_radius < 1
    margins = {condition.name: condition.margin for condition in theory.conditions}
    return {**margins, **{bound.name: bound.steady_state for bound in theory.bounds}}


def fastest(scenario: nrs.Scenario) -> nrs.Scenario:
    """Return the scenario with the gains that converge fastest."""
    return nrs.design(scenario, "fastest").scenario


def progress(t: float, duration: float) -> None:
    """Say how far a run is."""
    assert 0 <= t <= duration


async def main(scenario: nrs.Scenario) -> str | None:
    """Return the digest of a run beside a loop."""
    recording = await asyncio.to_thread(nrs.run, scenario, progress=progress)
    with recording:
        return recording.digest


def script() -> None:
    """Use all the rest."""
    paper = nrs.Scenario.load("scenarios/paper_first_order.toml")
    scenario = paper.replace({"run.duration": 1.0, "algorithm.alpha": np.float64(0.8)})
    assert isinstance(nrs.Estimate(np.zeros(2), np.zeros(2)).position, np.ndarray)
    algorithm: nrs.Algorithm = Damped()
    print(
        Falling().flow(nrs.Values(position=np.zeros(1), velocity=np.ones(1), pull=np.ones(1)), 1.0)
    )
    print(algorithm, sorted(theory_of(scenario)))
    with nrs.run(scenario, Path("run.mcap"), workers=1) as recording:
        position, velocity = recording.target("sampling")
        print(recording.status, recording.ticks, largest(recording), position - velocity)
        print(recording.states(robots=3)["t"].max(), recording.times("output").shape)
        about: dict[str, object] = recording.analysis()
        print(about["digest"] == asyncio.run(main(scenario)), recording.to_scenario() == scenario)
        verification = nrs.replay.verify(recording, agents_only=True)
        print(verification.status, verification.messages)
        with nrs.replay.what_if(recording, {"controller.kp": 150.0}, robots=[2]) as other:
            comparison = nrs.compare(recording, other)
            print(comparison.is_same, comparison.fields, other.reason)
    with nrs.resume("run.mcap", "long.mcap", changes={"run.duration": 2.0}) as longer:
        print(longer.ticks, longer.damage)
    study: nrs.Study = nrs.sweep(scenario, {"algorithm.alpha": [0.8, 0.9]}, seeds=[1], jobs=0)
    print(len(study), study.keys, study.dataset().sizes, study.statistics().columns.size)
    try:
        nrs.run(scenario, "run.mcap")
    except nrs.errors.InputError as error:
        print(str(error).split(":")[0])
    except nrs.errors.RunError as error:
        print(error.cause.tick)


if __name__ == "__main__":
    script()
