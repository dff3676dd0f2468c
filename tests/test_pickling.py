"""A scenario travels to other processes, with what it names, and is the same one there."""

import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import nrs_cosim as nrs
from tests.guard import GUARD
from tests.scenarios import PAPER_FILE

EDGES = "source,sink,weight\n0,1,1.0\n1,2,1.0\n2,1,0.5\n"


def with_edges(folder):
    """Return a scenario whose edges are in a file."""
    (folder / "edges.csv").write_text(EDGES, "utf-8")
    text = nrs.Scenario.load(PAPER_FILE).replace({"network.edge_list": [[0, 1], [1, 2]]}).to_toml()
    scenario = nrs.Scenario.parse(text, folder=folder, name="two")
    return scenario.replace({"network.edges": "edges.csv", "run.duration": 1.0})


def test_a_scenario_is_the_same_in_a_process_that_was_spawned(tmp_path):
    scenario = with_edges(tmp_path)
    (tmp_path / "edges.csv").unlink()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        text = pool.submit(nrs.Scenario.to_toml, scenario).result(timeout=GUARD)
        other = pool.submit(nrs.Scenario.replace, scenario, {"run.seed": 7}).result(timeout=GUARD)
    assert text == scenario.to_toml()
    assert other == scenario.replace({"run.seed": 7})
    assert (other.name, repr(other)) == ("two", repr(scenario))


def test_a_scenario_of_a_recording_keeps_its_assets_and_runs_the_same(tmp_path):
    with nrs.run(with_edges(tmp_path)) as recording:
        digest, scenario = recording.digest, recording.to_scenario()
    (tmp_path / "edges.csv").unlink()
    again = pickle.loads(pickle.dumps(scenario))
    assert again == scenario
    with nrs.run(again) as recording:
        assert recording.digest == digest
