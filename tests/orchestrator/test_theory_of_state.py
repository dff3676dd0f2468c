"""Of an algorithm that keeps more than an estimate, and declares no modes, its code is asked."""

import json
import sys

import numpy as np
import pytest

from nrs_cosim.recordings.export.tables import samples
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.estimator_agents.paper import ONE, D
from tests.scenarios import PAPER_FILE, write

MODULE = """
from dataclasses import dataclass
from typing import ClassVar

import nrs_cosim as nrs
from nrs_cosim.bus.fields import ESTIMATE, Field


@dataclass(frozen=True)
class Remembering(nrs.Algorithm):
    STATE: ClassVar = {**ESTIMATE, "last": Field(doc="the disagreement at the time before")}
    alpha: float
    beta: float
    gamma: float = nrs.parameter("gain on the last disagreement", 0.1)

    def receive(self, now, x, received):
        position = received.disagreement("position", x.position)
        velocity = received.disagreement("velocity", x.velocity)
        return x.replace(
            position=x.position + self.alpha * position + self.gamma * x["last"],
            velocity=x.velocity + self.beta * velocity,
            last=position,
        )
"""
THEIRS = {"algorithm.name": "remembering"}


@pytest.fixture
def remembering(tmp_path, monkeypatch):
    """Return the paper's example with an algorithm that an installer has put there."""
    (tmp_path / "remembering.py").write_text(MODULE, "utf-8")
    about = tmp_path / "remembering-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: remembering\nVersion: 1.0\n")
    entry = "remembering = remembering:Remembering"
    (about / "entry_points.txt").write_text(f"[nrs.algorithms]\n{entry}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield write(tmp_path / "s.toml", THEIRS)
    sys.modules.pop("remembering", None)


def matrix(alpha, beta, gamma, h=0.1):
    """Return A of [ε̄; ῡ; what is remembered], by hand."""
    L, P, none = ONE - D, ONE - beta * (ONE - D), 0 * ONE
    return np.block([[ONE - alpha * L, h * P, gamma * ONE], [none, P, none], [-L, none, none]])


@pytest.mark.parametrize("gamma", [0.1, -0.2, 0.6])
def test_its_spectral_radius_is_that_of_the_matrix_by_hand(remembering, gamma):
    done = nrs("check", remembering, "--set", f"algorithm.gamma={gamma}", "--json")
    result = json.loads(done.stdout)
    radius = max(abs(np.linalg.eigvals(matrix(0.9, 1.1, gamma))))
    assert result["spectral_radius"] == pytest.approx(radius, rel=1e-6)
    assert result["convergence"] == ("converges" if radius < 1 else "diverges")
    assert result["parameters"]["gamma"] == gamma


def test_its_steady_state_is_what_a_run_comes_to(remembering, tmp_path):
    done = nrs("run", remembering, "-o", tmp_path / "run.mcap", "--json")
    assert done.returncode == 0, done.stderr
    theory = json.loads(done.stdout)["theory"]
    position, velocity = theory["quantities"][:2]
    for row in (position, velocity):
        assert row["status"] == "within"
        assert row["measured"] == pytest.approx(row["bounds"]["steady_state"], rel=1e-3)
        assert row["measured"] <= row["bounds"]["steady_state"] * (1 + 1e-9) + row["transient"]
    assert theory["measured_radius"] == pytest.approx(theory["spectral_radius"], rel=1e-2)


def test_what_is_left_of_its_beginning_is_beside_the_steady_state(tmp_path):
    """α is small, so that positions are not yet near to it: only what remains explains them."""
    change = "algorithm={name='dcea3',alpha=0.1,beta=0.6,gamma=0.5},initial.acceleration=3"
    done = nrs("run", PAPER_FILE, "--set", change, "-o", tmp_path / "run.mcap", "--json")
    position = json.loads(done.stdout)["theory"]["quantities"][0]
    bound, left = position["bounds"]["steady_state"], position["transient"]
    assert position["status"] == "transient"
    assert bound < position["measured"] <= bound + left
    assert left < 0.1 * bound


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ("run={sampling_jitter=0.5}", "of sampling times that are drawn it is computed where"),
        ("algorithm={name='kalman_consensus',q=1,r=1}", "the algorithm is not known to be linear"),
        ("algorithm={name='sliding',alpha=1,beta=1}", "the algorithm does not jump linearly"),
    ],
)
def test_where_nothing_is_known_it_is_said_why(remembering, change, why):
    done = nrs("check", remembering, "--set", change)
    assert (done.returncode, done.stderr) == (0, "")
    assert why in " ".join(done.stdout.split())


def bounds_of(algorithm):
    done = nrs("check", PAPER_FILE, "--set", f"algorithm={algorithm}", "--json")
    result = json.loads(done.stdout)
    assert result["why_not"] == ""
    return result


def test_a_triggered_algorithm_has_the_bounds_of_its_own_and_of_what_is_not_sent():
    plain = bounds_of("{name='dcea1',alpha=0.9,beta=1.1}")
    triggered = bounds_of("{name='event_triggered',alpha=0.9,beta=1.1,c0=0.03,d0=0.01}")
    none, h = np.zeros((6, 6)), 0.1
    A = matrix(0.9, 1.1, 0.0)[:12, :12]
    received = np.block([[0.9 * D, h * 1.1 * D], [none, 1.1 * D]])
    added, power = np.zeros(12), received
    for _ in range(3000):
        added += np.abs(power) @ np.repeat([0.03, 0.01], 6)
        power = A @ power
    assert abs(power).max() < 1e-15
    for kind in ("steady_state", "worst_case"):
        for name, more in zip(
            ("position", "velocity"), added.reshape(2, 6).max(axis=1), strict=True
        ):
            expected = plain["estimates"][kind][name] + more
            assert triggered["estimates"][kind][name] == pytest.approx(expected, rel=1e-9)
    assert triggered["spectral_radius"] == plain["spectral_radius"]
    assert triggered["estimates"]["paper"] is None


def test_a_run_of_a_triggered_algorithm_is_within_them(tmp_path):
    change = "algorithm={name='event_triggered',alpha=0.9,beta=1.1,c0=0.3,d0=0.3}"
    done = nrs("run", PAPER_FILE, "--set", change, "-o", tmp_path / "run.mcap", "--json")
    theory = json.loads(done.stdout)["theory"]
    assert [row["status"] for row in theory["quantities"][:2]] == ["within"] * 2
    assert theory["measured_radius"] is None
    shown = " ".join(nrs("check", PAPER_FILE, "--set", change).stdout.split())
    assert (
        "silence sampling periods between two samples of a robot: at least 1 to 3, by robot; "
        "samples of a robot a second: at most 8.889 in the mean (statement E2)"
    ) in shown
    with Reader(tmp_path / "run.mcap") as reader:
        sent = np.concatenate([found[["robot", "k"]] for found in samples(reader)])
    late = sent[sent["k"] > 100]
    gaps = [np.diff(late["k"][late["robot"] == robot]).min() for robot in range(1, 7)]
    assert np.greater_equal(gaps, [1, 1, 3, 1, 1, 1]).all()


def test_what_is_wrong_with_its_nominal_algorithm_is_one_line(remembering):
    path = remembering.with_name("remembering.py")
    module = MODULE + "\n    def nominal(self):\n        return 3\n"
    path.write_text(module, "utf-8")
    sys.modules.pop("remembering", None)
    done = nrs("check", remembering)
    line = module.splitlines().index("    def nominal(self):") + 1
    assert done.returncode == 2
    assert " ".join(done.stderr.split()) == (
        "error: algorithm.name: remembering.nominal(): TypeError: cannot unpack non-iterable int "
        f"object, at {path}:{line}"
    )


TRIGGERED = """

@dataclass(frozen=True)
class Seldom(Remembering):
    STATE: ClassVar = {
        **Remembering.STATE,
        "sent_position": Field(),
        "sent_velocity": Field(),
        "sent_at": Field((1,), initial=-1.0),
    }
    TRIGGERED: ClassVar = True
    MISSING: ClassVar = ("hold",)
    off: float = nrs.parameter("how far off an estimate may be", 0.1, least=0)

    def flow(self, x, dt):
        moved = Remembering.flow(self, x, dt)
        return moved.replace(sent_position=x.sent_position + dt * x.sent_velocity)

    def send(self, now, x):
        apart = [x[name] - x["sent_" + name] for name in ("position", "velocity")]
        sends = (np.abs(apart).max(axis=(0, 2)) > self.off) | (x.sent_at[:, 0] < 0)
        sent = {"sent_position": x.position, "sent_velocity": x.velocity}
        sent["sent_at"] = np.full_like(x.sent_at, now.t)
        after = {name: np.where(sends[:, None], new, x[name]) for name, new in sent.items()}
        return x.replace(**after), type(x)(position=x.position, velocity=x.velocity), sends

    def receive(self, now, x, received):
        elapsed = (received.age * now.h)[:, None]
        sample = received.samples
        position = received.mean(
            sample.position + elapsed * sample.velocity - received.own(x.position)
        )
        velocity = received.disagreement("velocity", x.velocity)
        return x.replace(
            position=x.position + self.alpha * position + self.gamma * x["last"],
            velocity=x.velocity + self.beta * velocity,
            last=position,
        )

    def nominal(self):
        off = {"position": self.off, "velocity": self.off}
        return Remembering(self.alpha, self.beta, self.gamma), off
"""


def test_a_gain_a_memory_and_a_trigger_of_another_package_have_their_bounds(remembering, tmp_path):
    path = remembering.with_name("remembering.py")
    path.write_text("import numpy as np\n" + MODULE + TRIGGERED, "utf-8")
    entries = next(remembering.parent.glob("*.dist-info")) / "entry_points.txt"
    entries.write_text(f"{entries.read_text()}seldom = remembering:Seldom\n")
    sys.modules.pop("remembering", None)
    change = "algorithm={name='seldom',alpha=0.9,beta=1.1,off=0.1}"
    done = nrs("run", remembering, "--set", change, "-o", tmp_path / "run.mcap", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert [row["status"] for row in result["theory"]["quantities"][:2]] == ["within"] * 2
    radius = max(abs(np.linalg.eigvals(matrix(0.9, 1.1, 0.1))))
    assert result["theory"]["spectral_radius"] == pytest.approx(radius, rel=1e-6)
    own = json.loads(nrs("check", remembering, "--json").stdout)["estimates"]["steady_state"]
    none, h = np.zeros((6, 6)), 0.1
    A, received = matrix(0.9, 1.1, 0.1), [[0.9 * D, h * 1.1 * D], [none, 1.1 * D], [D, none]]
    added, power = np.zeros(18), np.block(received)
    for _ in range(3000):
        added += np.abs(power) @ np.full(12, 0.1)
        power = A @ power
    bound = result["theory"]["quantities"][0]["bounds"]["steady_state"]
    assert bound == pytest.approx(own["position"] + added[:6].max(), rel=1e-9)
