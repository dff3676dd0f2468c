"""Where little is to be had, as in containers and on clusters, a run says what it lacks."""

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import pytest

from nrs_cosim.bus.errors import BusError, InputError, RunError
from nrs_cosim.bus.network import sessions
from nrs_cosim.orchestrator.cluster import launcher, worker_state
from nrs_cosim.orchestrator.cluster.launcher import local_workers
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.plant_fmu.fmi import library
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.guard import GUARD
from tests.scenarios import SCENARIOS, SHORT, paper

SCENARIO = SCENARIOS / "paper_first_order.toml"


def limited(which: int, most: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(which, (most, most))


@pytest.mark.parametrize("workers", [(), ("--workers", "2")], ids=["alone", "two workers"])
@pytest.mark.parametrize(
    ("which", "most", "lacks"),
    [
        (resource.RLIMIT_AS, 400_000 * 1024, "512 MiB more of addresses"),
        (resource.RLIMIT_NOFILE, 10, "16 more file descriptors"),
    ],
    ids=["addresses", "descriptors"],
)
def test_too_little_memory_or_file_descriptors_is_one_clear_line(
    tmp_path, which, most, lacks, workers
):
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "nrs_cosim.orchestrator",
            "run",
            SCENARIO,
            "-o",
            tmp_path / "x.mcap",
            *workers,
        ],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "COLUMNS": "500"},
        preexec_fn=limited(which, most),
        capture_output=True,
        text=True,
        check=False,
        timeout=GUARD,
    )
    assert done.returncode == 1, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"this process may not have {lacks}" in line
    assert "raise the limit: `ulimit -" in line


def test_too_few_threads_are_reported_and_started_processes_end(monkeypatch):
    started = []

    class Few(Thread):
        def start(self):
            if len(started) == 3:
                raise RuntimeError("can't start new thread")
            started.append(self)
            super().start()

    monkeypatch.setattr(sessions, "Thread", Few)
    with pytest.raises(BusError, match=r"may not have 16 more threads \(can't start new thread\)"):
        sessions.expect_room()
    assert [thread.is_alive() for thread in started] == [False] * 3


ODD = ["x" * 140, "a#b", "ü", "a b", "a;b", "a?b"]


@pytest.mark.parametrize("name", cases(ODD, ODD[:1]))
def test_workers_use_a_short_socket_folder_when_tmpdir_is_long_or_odd(tmp_path, monkeypatch, name):
    odd = tmp_path / name
    odd.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(odd))
    monkeypatch.setenv("TMPDIR", str(odd))
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    file = paper(SHORT)
    shown = []
    launch = local_workers(file, 2, WorkerPolicy(True, GUARD, shown.append))
    assert run(file, tmp_path / "two.mcap", launch).status == "completed", shown
    assert run(file, tmp_path / "one.mcap").status == "completed"
    with Reader(tmp_path / "one.mcap") as one, Reader(tmp_path / "two.mcap") as two:
        assert one.digest == two.digest
    assert list(odd.iterdir()) == []


def test_when_no_socket_folder_is_usable_tmpdir_is_named(tmp_path, monkeypatch):
    class Stack:
        def enter_context(self, _context):
            raise PermissionError

    monkeypatch.setattr(launcher, "own_folder", lambda place: place)
    with pytest.raises(InputError, match=r"TMPDIR: a socket cannot be in .*a b, nor in XDG_RUNTIM"):
        launcher.meeting_place(Stack(), tmp_path / "a b" / "own")


def test_a_library_on_a_noexec_disk_is_reported(tmp_path, monkeypatch):
    folder = tmp_path / "own"
    folder.mkdir()
    assert library._advice(folder) == ""
    result = SimpleNamespace(f_flag=os.ST_NOEXEC)
    monkeypatch.setattr(library.os, "statvfs", lambda _path: result)
    assert library._advice(folder) == (
        f"; {tmp_path} is mounted noexec: set TMPDIR to a folder on another disk"
    )


def test_a_worker_of_this_machine_that_never_asks_to_join_ends_the_run(tmp_path, monkeypatch):
    class Mute:
        def __init__(self, *_given, **_more):
            pass

        def ending(self):
            return None

        def kill(self):
            return "was ended"

        def last_words(self):
            return "; it printed: panicked"

    monkeypatch.setattr(launcher, "LocalWorker", Mute)
    monkeypatch.setattr(worker_state, "STARTING_UP", 0.1)
    launch = local_workers(paper(SHORT), 2, WorkerPolicy(True, GUARD, lambda _text: None))
    with pytest.raises(
        RunError, match=r"worker local-1 \(robots 1-3\), a process of this machine"
    ) as e:
        run(paper(SHORT), tmp_path / "x.mcap", launch)
    assert str(e.value).endswith("within 0.1 s of its start; it printed: panicked")
