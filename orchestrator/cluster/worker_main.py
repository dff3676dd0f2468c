"""The process of a worker that the orchestrator starts here: `nrs worker` without a command line.

It imports little, so that it is soon there, and it ends with the orchestrator.
"""

import logging
from argparse import ArgumentParser

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.orchestrator.cluster.worker_client import JoinOptions, serve
from nrs_cosim.orchestrator.logs import log_as_asked
from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots
from nrs_cosim.plant_fmu.processes import follow_parent


def main() -> None:
    """Join the run at an endpoint, for some robots."""
    parser = ArgumentParser()
    kinds = {"connect": str, "name": str, "robots": str, "wait": float, "threads": int}
    for name, kind in kinds.items():
        parser.add_argument(f"--{name}", required=True, type=kind)
    parser.add_argument("--log-to", type=int)
    arguments = parser.parse_args()
    follow_parent()
    log_as_asked(arguments.log_to, arguments.name)
    logging.getLogger("nrs").addHandler(logging.NullHandler())  # the orchestrator says it
    np.seterr(all="ignore")  # what is not finite is looked for and named, not warned of
    robots = parse_robots(arguments.robots, "--robots")
    options = JoinOptions(
        arguments.name,
        robots,
        run=None,
        wait=arguments.wait,
        allow_fmus=False,
        stays=False,
        show=lambda _text: None,
        threads=arguments.threads,
        is_own=True,
    )
    try:
        serve(options, Endpoints(connect=(arguments.connect,), wait=arguments.wait))
    except CosimError as error:
        raise SystemExit(f"error: {error}") from None
