"""A recording that was made with libraries' mathematics is verified by these.

`former.mcap` is of such a version: two robots of four ticks. Its links add NumPy's normal draws,
rounded to thousandths; each sine and cosine of its target is within a fifth of a unit in the last
place of a double, which all libraries return.
"""

from math import exp
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.special import ndtri

from nrs_cosim.bus.former_mathematics import former_mathematics
from nrs_cosim.bus.mathematics import exponential, normal_quantile, sine
from nrs_cosim.bus.random_streams import normal, random_stream
from nrs_cosim.estimator_agents.target import Sampled
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.orchestrator.test_replay import flipped, rewritten

FORMER = Path(__file__).with_name("former.mcap")


def test_it_comes_to_the_same_bits_by_the_mathematics_of_then():
    with Reader(FORMER, verify=True) as reader:
        assert not reader.damage
        found = verify(reader, experiment_of(reader), plants=False)
        assert (found.status, found.messages, found.by_libraries) == ("identical", 34, True)
    done = nrs("replay", FORMER, "--verify", "--agents-only")
    assert done.returncode == 0
    assert "draws are those of libraries, as when it was recorded" in done.stdout


def test_by_todays_mathematics_its_noise_is_another(monkeypatch):
    monkeypatch.setattr("nrs_cosim.recordings.metadata.About.is_former", False)
    with Reader(FORMER) as reader:
        found = verify(reader, experiment_of(reader), plants=False)
        assert (found.status, found.by_libraries) == ("differs", False)
        assert found.difference.topic.endswith("/link_event")


def test_what_differs_in_it_is_found_and_the_libraries_are_named(tmp_path):
    rewritten(FORMER, tmp_path / "bad.mcap", flipped("/target/sample", 3, 41))
    done = nrs("replay", tmp_path / "bad.mcap", "--verify", "--agents-only")
    assert done.returncode == 1
    assert "differs: tick 3, t = 0.3 s: /target/sample, velocity of robot 0 is" in done.stderr
    assert "sin, cos and draws were those of libraries (numpy 2.4.6, scipy 1.17.1" in done.stderr


def test_without_its_fmu_what_can_be_verified_is_said(monkeypatch):
    monkeypatch.setattr("nrs_cosim.orchestrator.engine.plants.built_here", lambda *_: None)
    done = nrs("replay", FORMER, "--verify")
    assert done.returncode == 2
    assert (
        "another version built, and the cache has not; without it, replay --verify" in done.stderr
    )


def test_it_does_not_go_on_otherwise_than_it_began(tmp_path):
    (tmp_path / "cut.mcap").write_bytes(FORMER.read_bytes()[:-2000])
    done = nrs("resume", tmp_path / "cut.mcap", "-o", tmp_path / "rest.mcap")
    assert done.returncode == 2
    assert "was made when sin, cos and draws were those of libraries" in done.stderr


X = np.linspace(0.01, 0.99, 40)
FORMERLY = {
    "sin": (lambda: sine(9 * X), lambda: np.sin(9 * X)),
    "exp": (lambda: exponential(-X), lambda: np.array([exp(-x) for x in X])),
    "quantile": (lambda: normal_quantile(X), lambda: ndtri(X)),
    "draws": (
        lambda: normal(random_stream(1, "x", 2), (7, 3)),
        lambda: random_stream(1, "x", 2).standard_normal((7, 3)),
    ),
    "spline": (
        lambda: Sampled.of(X, np.sin(9 * X)[:, None]).at(X[:-1] + 0.01).velocity,
        lambda: CubicSpline(X, np.sin(9 * X)[:, None])(X[:-1] + 0.01, 1),
    ),
    "cubics": (
        lambda: Sampled.through(X, X[:, None] ** 2, 2 * X[:, None]).acceleration(X[:-1] + 0.01),
        lambda: CubicHermiteSpline(X, X[:, None] ** 2, 2 * X[:, None])(X[:-1] + 0.01, 2),
    ),
}


@pytest.mark.parametrize("name", FORMERLY)
def test_libraries_compute_while_it_is_asked_for(name):
    ours, theirs = FORMERLY[name]
    own = ours()
    with former_mathematics(True):
        assert ours().tobytes() == theirs().tobytes()
    with former_mathematics(False):
        assert ours().tobytes() == own.tobytes()
