"""Growth of errors is what the recording has, and chance is not taken for it."""

import numpy as np
import pytest

import nrs_cosim as nrs
from nrs_cosim.orchestrator.engine.growth import Growth, growth_of
from nrs_cosim.recordings.mcap.reader import Reader
from tests.scenarios import paper


@pytest.mark.parametrize(
    ("earlier", "before", "after", "grown"),
    [
        (1.0, 1.6, 2.6, True),
        (1.0, 1.0, 1.6, False),
        (2.0, 1.0, 1.9, False),
        (1.0, 1.6, 1.6, False),
        (5.0, 1.0, 0.2, False),
        (0.0, 0.0, 0.0, False),
    ],
)
def test_what_grows_does_so_in_each_of_two_quarters(earlier, before, after, grown):
    assert Growth(earlier, before, after, 100).has_grown is grown


def test_the_rate_is_that_of_an_exponential():
    rate = 1.02
    sizes = [rate**25, rate**50, rate**75]
    assert Growth(*sizes, 100).rate == pytest.approx(rate, rel=1e-12)
    assert Growth(1.0, 0.0, 1.0, 100).rate is None


def test_the_quarters_are_of_the_errors_of_estimates_at_sampling_times(tmp_path):
    experiment = paper({"run.duration": 4.0, "algorithm.alpha": 1.25})
    scenario = nrs.Scenario._of(experiment)
    with nrs.run(scenario, tmp_path / "a.mcap") as recording:
        errors, ticks = recording.errors(), recording.times("sampling")
    largest = np.maximum(
        np.abs(errors["position_estimate"]).max(axis=1),
        np.abs(errors["velocity_estimate"]).max(axis=1),
    )
    at = [largest[np.isclose(errors["t"], t)].max() for t in ticks]
    with Reader(tmp_path / "a.mcap") as reader:
        found = growth_of(reader, experiment)
    assert found.earlier == max(at[10:20])
    assert (found.before, found.after) == (max(at[20:30]), max(at[30:]))
    assert found.has_grown
    theory = nrs.check(scenario).spectral_radius
    assert found.rate == pytest.approx(theory, rel=0.02)
