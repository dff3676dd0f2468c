"""An algorithm of another package, with a memory, a trigger and a sensor: one run anywhere."""

import json
import sys

import pytest

from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cluster.local_workers import LocalRun, digest, story
from tests.command import nrs
from tests.scenarios import example

pytestmark = pytest.mark.usefixtures("nothing_is_left")

TICKS = 120
MODULE = '''"""Third order with an integral, sent when an estimate has moved, of a noisy target."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

import nrs_cosim as nrs

ACCELERATION = {"acceleration": nrs.Field(truth="acceleration", doc="of the target")}


@dataclass(frozen=True)
class Patient(nrs.Algorithm):
    """Keeps an integral, and says little."""

    STATE: ClassVar = {
        **nrs.Algorithm.STATE,
        **ACCELERATION,
        "integral": nrs.Field(doc="of the disagreement"),
        "sent": nrs.Field(("m", 3), doc="what was sent last"),
        "sends": nrs.Field((), doc="how often"),
    }
    SENT: ClassVar = {**nrs.Algorithm.SENT, **ACCELERATION}
    LINK: ClassVar = {"trust": nrs.Field((1,), initial=1.0, doc="of an in-neighbour")}
    MISSING: ClassVar = ("hold",)
    TRIGGERED: ClassVar = True

    alpha: float = nrs.parameter("gain on the positions", above=0)
    beta: float = nrs.parameter("gain on the velocities", above=0)
    gamma: float = nrs.parameter("gain on the accelerations", above=0)
    ki: float = nrs.parameter("gain on the integral", 0.05, least=0)
    c0: float = nrs.parameter("what is let pass", 0.2, unit="rad", least=0)
    sigma: float = nrs.parameter("standard deviation of a measurement", 0.02, unit="rad", least=0)

    def flow(self, x, dt):
        return x.replace(
            position=x.position + dt * (x.velocity + dt / 2 * x.acceleration),
            velocity=x.velocity + dt * x.acceleration,
        )

    def measure(self, now, target):
        noise = self.sigma * now.normal("look", target.position.shape[-1])
        return target.replace(position=target.position + noise)

    def send(self, now, x):
        now_said = np.stack([x.position, x.velocity, x.acceleration], axis=-1)
        sends = (np.abs(now_said - x.sent).max(axis=(1, 2)) > self.c0) | (now.k == 1)
        after = x.replace(
            sent=np.where(sends[:, None, None], now_said, x.sent), sends=x.sends + sends
        )
        return after, nrs.Values({name: x[name] for name in self.SENT}), sends

    def receive(self, now, x, received):
        apart = received.disagreement("position", x.position)
        integral = x.integral + apart
        trust = np.where(received.present[:, None], 0.9 * received.links.trust + 0.1, 0.5)
        pull = received.mean(trust * received.difference("acceleration", x.acceleration))
        return x.replace(
            position=x.position + self.alpha * apart + self.ki * integral,
            velocity=x.velocity + self.beta * received.disagreement("velocity", x.velocity),
            acceleration=x.acceleration + self.gamma * pull,
            integral=integral,
        ), nrs.Values(trust=trust)
'''
CHANGES = {
    "algorithm": {"name": "patient", "alpha": 0.7, "beta": 0.6, "gamma": 0.4},
    "run.checkpoint_every": 20,
    "run.duration": TICKS / 10,
}


@pytest.fixture
def file(tmp_path, monkeypatch):
    """Return the lossy example, late too, with that algorithm installed for every process."""
    package = tmp_path / "package"
    about = package / "patient-1.0.dist-info"
    about.mkdir(parents=True)
    (package / "patient.py").write_text(MODULE, "utf-8")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: patient\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[nrs.algorithms]\npatient = patient:Patient\n")
    monkeypatch.syspath_prepend(str(package))
    monkeypatch.setenv("PYTHONPATH", str(package))
    yield example("paper_lossy_links", CHANGES)
    sys.modules.pop("patient", None)


def test_it_is_one_run_in_one_process_and_on_workers_that_die(file, tmp_path):
    run(file, tmp_path / "1.mcap")
    spread = LocalRun(file, 3).kill(25, 1).kill(70, 2, 3)
    outcome = spread.run(tmp_path / "3.mcap")
    assert (outcome.status, outcome.reason, outcome.ticks) == ("completed", "", TICKS)
    assert outcome.restarts == 3
    assert story(outcome.path) == story(tmp_path / "1.mcap")
    assert digest(outcome.path) == digest(tmp_path / "1.mcap")

    done = nrs("replay", "--verify", outcome.path)
    assert (done.returncode, done.stderr) == (0, "")
    done = nrs("replay", "--verify", "--agents-only", outcome.path)
    assert (done.returncode, done.stderr) == (0, "")

    with Recording(outcome.path) as recording:
        assert recording.measurements()["k"].tolist() == [*range(1, TICKS + 1)]

    samples = json.loads(nrs("info", outcome.path, "--json").stdout)["samples"]
    assert 0 < samples["per_robot_and_second"] < 10
    assert samples["per_robot_and_second"] == pytest.approx(samples["count"] / 6 / (TICKS / 10))
    with Reader(outcome.path) as reader:
        sent = [m for tick in past_of(reader) for m in tick if m[1].endswith("/sample")]
    assert samples["count"] == len([m for m in sent if not m[1].startswith("/target")])
    assert len(sent) - samples["count"] == TICKS
