"""Ten thousand robots: nothing is lost, and the estimates are those of the paper's recursion.

The oracle is written from the paper with sparse matrices, and shares no code with the agents.
"""

import numpy as np
from scipy.sparse import csr_array

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings import Recording
from tests.orchestrator.run_oracle import target
from tests.scenarios import SCENARIOS

N, TICKS, H, GAIN = 10_000, 100, 0.05, 0.9


def recursion(share, position, velocity):
    """Return ε_i(t_K), υ_i(t_K) before the jump there (equation 3.3); `share` is (n, n + 1)."""
    for k in range(1, TICKS):
        position = position + H * velocity
        e0, v0 = target(k * H)
        seen = share @ np.vstack([e0, position]), share @ np.vstack([v0, velocity])
        position, velocity = (
            position + GAIN * (seen[0] - position),
            velocity + GAIN * (seen[1] - velocity),
        )
    return position + H * velocity, velocity


def test_ten_thousand_robots(tmp_path):
    file = read_scenario(SCENARIOS / "random_10000.toml")
    outcome = run(file, tmp_path / "run.mcap")
    assert (outcome.status, outcome.ticks, outcome.rejected) == ("completed", TICKS, {})
    assert outcome.messages == TICKS * (N + 1) + (TICKS + 1) * N
    topology = file.topologies.links
    edges = csr_array(
        (np.ones(len(topology.sink)), (topology.sink - 1, topology.source)), shape=(N, N + 1)
    )
    share = edges / edges.sum(axis=1)[:, None]
    with Recording(outcome.path) as recording:
        first = recording.states(end=H / 2)
        last = recording.states(start=(TICKS - 0.5) * H)
    for rows in (first, last):
        assert np.array_equal(rows["robot"], np.arange(1, N + 1))
    start = first["reference_position"], first["reference_velocity"]
    position, velocity = recursion(csr_array(share), *start)
    np.testing.assert_allclose(last["reference_position"], position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(last["reference_velocity"], velocity, rtol=0, atol=1e-12)
    assert np.linalg.norm(last["position"] - last["reference_position"], axis=1).max() < 1.0
