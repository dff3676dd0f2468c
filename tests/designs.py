"""Many designs for an accuracy, linear robots against their worst and arms in runs.

python -m tests.designs [--plants 300] [--arms 20]
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from tests.estimator_agents.test_tracking_bounds import designed_linear
from tests.orchestrator.test_design import accuracy_of_a_run


def main() -> int:
    """Say how near designs come to what they promise; 1 where one breaks it."""
    parser = argparse.ArgumentParser(prog="python -m tests.designs", description=__doc__)
    parser.add_argument("--plants", type=int, default=300)
    parser.add_argument("--arms", type=int, default=20)
    asked = parser.parse_args()
    rng = np.random.default_rng(2026)
    shares = []
    for _ in range(asked.plants):
        wanted, worst = designed_linear(rng)
        shares.append((worst[0] / wanted.position, worst[1] / wanted.velocity))
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(asked.arms):
            wanted, seen = accuracy_of_a_run(Path(folder), "two_link_arm", 100 + seed)
            shares.append(
                (
                    seen.position_tracking / wanted.position,
                    seen.velocity_tracking / wanted.velocity,
                )
            )
    largest = np.max(shares, axis=1)
    print(f"{len(shares)} designs: median {np.median(largest):.3f}, largest {largest.max():.3f}")
    return int(largest.max() > 1 + 1e-6)


if __name__ == "__main__":
    sys.exit(main())
