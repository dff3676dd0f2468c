"""The door for Python: scenarios made in code, runs wherever Python runs, recordings at hand."""

import asyncio
import json
import os
import re
import signal
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

import nrs_cosim as nrs
from tests.command import nrs as command
from tests.guard import GUARD
from tests.scenarios import SCENARIOS

ROOT = Path(__file__).parents[2]
PAPER = SCENARIOS / "paper_first_order.toml"
DIGEST = "5433c658"


class TestScenario:
    def test_a_loaded_scenario_keeps_the_users_text(self, paper):
        assert paper.to_toml() == PAPER.read_text("utf-8")
        assert nrs.Scenario.parse(paper.to_toml(), folder=PAPER.parent) == paper

    def test_a_scenario_made_of_tables_runs_as_the_file(self, paper):
        tables = tomllib.loads(paper.to_toml())
        built = nrs.Scenario(tables, folder=PAPER.parent)
        keywords = nrs.Scenario(**tables, folder=PAPER.parent)
        assert built == keywords == paper
        change = {"run.duration": 2.0}
        with nrs.run(built.replace(change)) as one, nrs.run(paper.replace(change)) as other:
            assert one.digest == other.digest

    def test_replace_gives_another_scenario_and_keeps_comments(self, paper):
        changed = paper.replace({"algorithm.alpha": np.float64(0.5), "run.seed": np.int64(3)})
        assert (changed["algorithm.alpha"], changed["run.seed"]) == (0.5, 3)
        assert paper["algorithm.alpha"] == 0.9
        comments = [line for line in paper.to_toml().splitlines() if line.startswith("#")]
        assert comments
        assert [x for x in changed.to_toml().splitlines() if x.startswith("#")] == comments

    def test_none_takes_a_key_out(self, paper):
        path = {"network.adjacency": np.eye(6, k=-1), "network.pinning": [1, 0, 0, 0, 0, 0]}
        edges = {
            "network.adjacency": None,
            "network.pinning": None,
            "network.edge_list": [[i, i + 1] for i in range(6)],
        }
        by_matrix, by_edges = paper.replace(path), paper.replace(edges)
        assert by_edges["network"] == {"edge_list": [[i, i + 1] for i in range(6)]}
        assert nrs.check(by_edges).as_json() == nrs.check(by_matrix).as_json()

    @pytest.mark.parametrize(
        ("changes", "robots"),
        [
            ({"plant.fmu": "n_link_arm", "plant.parameters.n": 2}, None),
            ({"controller.kp": 250.0}, [2, 3]),
            ({"network.edge_list": [[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [5, 6]]}, None),
            ({"run.sampling_times": [0.1, 0.3]}, None),
        ],
        ids=["another plant", "some robots", "another form of network", "other times"],
    )
    def test_replace_equals_set_of_the_command(self, paper, changes, robots):
        text = ",".join(f"{key}={json.dumps(value)}" for key, value in changes.items())
        only = f"robots={','.join(map(str, robots))}," if robots else ""
        printed = json.loads(command("check", PAPER, "--set", only + text, "--json").stdout)
        mine = nrs.check(paper.replace(changes, robots=robots)).as_json()
        assert json.loads(json.dumps(mine)) == printed

    def test_all_errors_are_named_at_once(self, paper):
        with pytest.raises(nrs.errors.InputError) as refused:
            paper.replace({"algorithm.alfa": 1.0, "run.seed": "x"})
        assert "algorithm.alfa: unknown key; did you mean 'alpha'?" in str(refused.value)
        assert "run.seed" in str(refused.value)

    def test_the_schema_is_that_of_the_command(self):
        assert nrs.Scenario.schema() == json.loads(command("schema").stdout)


class TestTheory:
    def test_the_theory_is_that_of_the_command(self, paper):
        printed = json.loads(command("check", PAPER, "--json").stdout)
        assert json.loads(json.dumps(nrs.check(paper).as_json())) == printed


class TestRun:
    def test_the_papers_example_has_its_digest(self, paper, tmp_path):
        with nrs.run(paper, tmp_path / "run.mcap", workers=2) as recording:
            assert recording.digest.startswith(DIGEST)
            assert recording.path == tmp_path / "run.mcap"

    def test_a_run_without_output_is_deleted_when_closed(self, short):
        with nrs.run(short) as recording:
            folder = recording.path.parent
            assert recording.path.is_file()
        assert not folder.exists()

    def test_an_existing_recording_is_replaced_by_force(self, short, tmp_path):
        path = tmp_path / "run.mcap"
        nrs.run(short, path).close()
        with pytest.raises(nrs.errors.InputError, match="is there already"):
            nrs.run(short, path)
        with nrs.run(short.replace({"run.seed": 2}), path, force=True) as recording:
            assert recording.path == path
            assert recording.to_scenario()["run.seed"] == 2

    def test_a_diverging_run_is_recorded_with_the_reason(self, paper):
        with nrs.run(paper.replace({"algorithm.alpha": 1.9})) as recording:
            assert recording.status == "failed"
            assert "diverged" in recording.reason
            assert 0 < recording.ticks < 300

    def test_progress_ends_at_the_duration(self, short):
        seen: list[tuple[float, float]] = []
        nrs.run(short, progress=lambda t, end: seen.append((t, end))).close()
        assert seen[-1] == (2.0, 2.0)
        assert [t for t, _ in seen] == sorted(t for t, _ in seen)

    @pytest.mark.parametrize("deadline", [0, -1.0, float("nan")])
    def test_an_invalid_deadline_is_refused(self, short, deadline):
        with pytest.raises(nrs.errors.InputError, match="deadline: expected more than 0 s"):
            nrs.run(short, deadline=deadline)

    @pytest.mark.parametrize("workers", [0, 7, 1.5, "all"])
    def test_an_impossible_number_of_workers_is_refused(self, short, workers):
        with pytest.raises(nrs.errors.InputError, match="workers: expected auto or 1 to 6"):
            nrs.run(short, workers=workers)

    def test_a_run_works_in_a_thread_and_in_asyncio(self, short):
        with nrs.run(short) as recording:
            expected = recording.digest
        found: list[str] = []

        def task() -> None:
            with nrs.run(short) as recording:
                found.append(recording.digest)

        thread = threading.Thread(target=task)
        thread.start()
        thread.join()

        async def main() -> None:
            await asyncio.to_thread(task)
            task()

        asyncio.run(main())
        assert found == [expected] * 3

    def test_a_run_and_a_study_work_in_a_script_without_a_main_guard(self, tmp_path):
        script = tmp_path / "script.py"
        script.write_text(
            "import nrs_cosim as nrs\n"
            f"scenario = nrs.Scenario.load({str(PAPER)!r})\n"
            "with nrs.run(scenario, workers=2) as recording:\n"
            "    print(recording.digest)\n"
            "print(nrs.sweep(scenario.replace({'run.duration': 1.0}), {}, jobs=1))\n",
            "utf-8",
        )
        done = subprocess.run(
            [sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        digest, study = done.stdout.splitlines()
        assert digest.startswith(DIGEST)
        assert study == "Study(1 run: 1 converged)"
        assert done.stderr == ""

    def test_an_interrupt_closes_the_recording_and_is_raised(self, paper, tmp_path):
        path = tmp_path / "run.mcap"

        def progress(t: float, _end: float) -> None:
            if t >= 1.0:
                os.kill(os.getpid(), signal.SIGINT)

        before = signal.getsignal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            nrs.run(paper, path, progress=progress)
        assert signal.getsignal(signal.SIGINT) is before
        with nrs.Recording(path) as recording:
            assert recording.status == "interrupted"
            assert not recording.damage
            assert recording.ticks >= 9
            with nrs.resume(recording, tmp_path / "whole.mcap") as whole:
                assert whole.status == "completed"
                assert whole.digest.startswith(DIGEST)


class TestResume:
    def test_a_completed_run_is_extended_as_by_the_command(self, short, tmp_path):
        path = tmp_path / "short.mcap"
        with nrs.run(short, path) as begun, nrs.resume(
            begun, tmp_path / "a.mcap", changes={"run.duration": 4.0}
        ) as longer:  # fmt: skip
            assert (longer.status, longer.ticks) == ("completed", 40)
            assert longer.to_scenario()["run.duration"] == 4.0
            mine = longer.digest
        asked = ("resume", path, "-o", tmp_path / "b.mcap", "--set", "run.duration=4.0")
        assert command(*asked).returncode == 0
        with nrs.Recording(tmp_path / "b.mcap") as theirs:
            assert theirs.digest == mine
        with nrs.run(short.replace({"run.duration": 4.0})) as at_once:
            assert at_once.digest == mine

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            (None, "is completed: there is nothing to resume"),
            ({"run.duration": 2.0}, "is completed: there is nothing to resume"),
            ({"run.duration": 1.0}, r"changes run.duration: expected at least 2\.0 s, which are"),
            ({"algorithm.alpha": 0.5}, "changes algorithm.alpha: what is recorded was run with"),
            ({"run.duratio": 4.0}, "changes run.duratio: what is recorded was run with another"),
            ({"run.duration": "x"}, "run.duration"),
        ],
        ids=["nothing", "the same", "shorter", "another key", "a typo", "no number"],
    )
    def test_a_run_that_cannot_be_continued_is_named(self, short, changes, words):
        with nrs.run(short) as begun, pytest.raises(nrs.errors.InputError, match=words):
            nrs.resume(begun, changes=changes)

    def test_the_recording_itself_is_refused_as_output(self, short, tmp_path):
        path = tmp_path / "short.mcap"
        longer = {"run.duration": 4.0}
        with nrs.run(short, path), pytest.raises(nrs.errors.InputError, match="give another name"):
            nrs.resume(path, path, changes=longer, force=True)

    def test_a_run_that_was_to_replace_a_recording_is_the_one_continued(self, short, tmp_path):
        path = tmp_path / "run.mcap"
        nrs.run(short, path).close()

        def progress(t: float, _duration: float) -> None:
            if t >= 1.0:
                raise KeyboardInterrupt

        other = short.replace({"run.seed": 2})
        with pytest.raises(KeyboardInterrupt):
            nrs.run(other, path, force=True, progress=progress)
        with nrs.resume(path) as whole, nrs.run(other) as at_once:
            assert whole.digest == at_once.digest


def test_importing_the_package_loads_only_what_is_used():
    program = "import sys, nrs_cosim; nrs_cosim.__all__; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert not {"numpy", "scipy", "zenoh", "fmpy", "pydantic"} & set(done.stdout.split())


def leaves(error: type[Exception]) -> set[str]:
    """Return the names of the errors below one, as far as they are ours."""
    below = [kind for kind in error.__subclasses__() if kind.__module__.startswith("nrs_cosim")]
    return {error.__name__}.union(*map(leaves, below))


def test_the_error_classes_are_the_tree_that_is_drawn():
    drawn = re.findall(r"[├└│ ]*── (\w+)|^(CosimError)$", nrs.errors.__doc__, re.MULTILINE)
    names = {name or root for name, root in drawn}
    assert names == set(nrs.errors.__all__)
    for name in nrs.errors.__all__:
        assert issubclass(getattr(nrs.errors, name), nrs.errors.CosimError)
    # what is caught within this project, or is another base of a leaf, is not raised to users
    inside = {
        "Interrupted",
        "RejectedError",
        "AbandonedError",
        "EndedError",
        "RecordingError",
        "StillError",
        "UnstableStepError",
        "OverBudgetError",
    }
    assert leaves(nrs.errors.CosimError) - inside <= names


@pytest.mark.parametrize("call", [nrs.run, nrs.check, nrs.Scenario], ids=lambda call: call.__name__)
def test_a_path_in_place_of_a_scenario_is_refused_and_load_is_named(call):
    with pytest.raises(nrs.errors.InputError) as error:
        call("row.toml")
    assert str(error.value).startswith("scenario: expected ")
    assert str(error.value).endswith(", got 'row.toml'; nrs.Scenario.load reads a file")


def test_every_public_name_exists_with_its_docstring():
    for name in nrs.__all__:
        assert getattr(nrs, name).__doc__, name
    authors = {"Algorithm", "Disagreement", "Estimate", "Field", "Values", "parameter"}
    assert len({*nrs.__all__} - authors) <= 12
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        nrs.nothing  # noqa: B018


def test_a_notebook_runs_and_can_be_interrupted(tmp_path):
    cells = [
        f"import nrs_cosim as nrs; scenario = nrs.Scenario.load({str(PAPER)!r})",
        "recording = nrs.run(scenario, workers=2); recording",
        "import os, signal\n"
        "def interrupt(t, end):\n"
        "    if t >= 1.0: os.kill(os.getpid(), signal.SIGINT)\n"
        "try:\n"
        "    nrs.run(scenario, 'cut.mcap', progress=interrupt)\n"
        "except KeyboardInterrupt:\n"
        "    print(nrs.Recording('cut.mcap').status)",
    ]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    client = NotebookClient(book, timeout=GUARD, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    _, shown, printed = book.cells
    assert f"digest {DIGEST}" in shown.outputs[0]["data"]["text/plain"]
    assert DIGEST in shown.outputs[0]["data"]["text/html"]
    assert printed.outputs[0]["text"] == "interrupted\n"
