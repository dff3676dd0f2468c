"""mosaik: an event scheduler in Python; each arm is a simulator of its own, stepped by FMPy.

One more simulator, connected to all arms, takes their values. A connection of a chain is shifted by
one step, and its first value is what the arm before has at the start.
"""

from typing import Any

from mosaik import World
from mosaik_api_v3 import Simulator

from benchmarks.peers.fmpy_loop import opened
from benchmarks.peers.work import H, States, Work, report, start, timed

CONFIG = {
    name: {"python": f"benchmarks.peers.mosaik_world:{name}"} for name in ("ArmSimulator", "Taker")
}


class ArmSimulator(Simulator):
    """One arm."""

    def __init__(self) -> None:
        attributes = {"public": True, "params": [], "attrs": ["state", "position_ref"]}
        super().__init__({"models": {"Arm": attributes}})

    def init(self, sid: str, time_resolution: float, **given: Any) -> dict[str, Any]:
        """Take the FMU's instance."""
        self.arm, self.inputs, self.outputs = (given[name] for name in ("arm", "inputs", "outputs"))
        return super().init(sid, time_resolution)

    def create(self, num: int, model: str) -> list[dict[str, Any]]:  # noqa: ARG002
        """Return the arm."""
        return [{"eid": "arm", "type": model}]

    def step(self, time: int, inputs: dict[str, Any], max_advance: int) -> int:  # noqa: ARG002
        """Step it over (t, t + h]."""
        for received in inputs.get("arm", {}).get("position_ref", {}).values():
            self.arm.setReal(self.inputs, received[:2])
        self.arm.doStep(time / 10, H)
        return time + 1

    def get_data(self, outputs: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Return its q and qd."""
        return {"arm": {"state": self.arm.getReal(self.outputs)}}


class Taker(Simulator):
    """Takes the values of all arms."""

    def __init__(self) -> None:
        attributes = {"public": True, "params": [], "attrs": ["state"]}
        super().__init__({"models": {"Taker": attributes}})

    def init(self, sid: str, time_resolution: float, **given: Any) -> dict[str, Any]:
        """Take where the values go."""
        self.taken = given["taken"]
        return super().init(sid, time_resolution)

    def create(self, num: int, model: str) -> list[dict[str, Any]]:  # noqa: ARG002
        """Return the one that takes."""
        return [{"eid": "taker", "type": model}]

    def step(self, time: int, inputs: dict[str, Any], max_advance: int) -> int:  # noqa: ARG002
        """Take them."""
        self.taken.update(inputs["taker"]["state"])
        return time + 1

    def get_data(self, outputs: dict[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Return nothing."""
        return {}


def run(work: Work) -> tuple[float, States]:
    """Step all arms in one process, by the scheduler."""
    taken: dict[str, list[float]] = {}
    with opened(work) as (arms, inputs, outputs):
        world = World(CONFIG)
        entities = [
            world.start("ArmSimulator", arm=arm, inputs=inputs, outputs=outputs).Arm()
            for arm in arms
        ]
        taker = world.start("Taker", taken=taken).Taker()
        for entity in entities:
            world.connect(entity, taker, "state")
        if work.chain:
            for i in range(1, work.n):
                world.connect(
                    entities[i - 1],
                    entities[i],
                    ("state", "position_ref"),
                    time_shifted=True,
                    initial_data={"state": [*start(i - 1), 0.0, 0.0]},
                )
        whole = Work(work.fmu, work.n, 1, work.chain)

        def all_steps(_k: int) -> States:
            world.run(until=work.ticks, print_progress=False)
            return [taken[entity.full_id] for entity in entities]

        return timed(whole, all_steps)


if __name__ == "__main__":
    report(run)
