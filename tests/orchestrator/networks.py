"""Networks as a scenario says them, and the paper's example on them, for a second."""

from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.scenarios import SHORT, paper, write

PAPERS = [(3, 1), (2, 1), (1, 2), (0, 3), (3, 4), (1, 4), (4, 5), (3, 5), (2, 5), (3, 6)]
"""The edges j → i of the paper's example."""
PAPER = {"edge_list": PAPERS}
PATH = {"generator": {"kind": "path", "n": 6}}


def generator(**keys):
    return {"generator": keys}


def phases(*entries, **keys):
    """Return the network of switching topologies that are given as (from, network)."""
    return {**keys, "switching": [{"from": since, **network} for since, network in entries]}


def separate(position, velocity):
    """Return the network of one digraph for positions and one for velocities."""
    return {"position": position, "velocity": velocity}


def on(network, *changes):
    """Return the paper's example on another network."""
    return paper(SHORT, {"network": network}, *changes)


def read_on(network, folder):
    """Write the paper's example on another network into a folder, and read it."""
    return read_scenario(write(folder / "net.toml", SHORT, {"network": network}))


def edges(topology):
    """Return the edges (j, i) of a topology."""
    return {*zip(topology.source.tolist(), topology.sink.tolist(), strict=True)}
