"""Workers join a run over loopback, are refused with the reason, die, and come back: same bits."""

import json
import re
import sys
import threading
from math import inf

import pytest

from nrs_cosim.bus.errors import BusError, InputError, RunError
from nrs_cosim.orchestrator.cli.main import main
from nrs_cosim.orchestrator.cluster import coordinator, worker_client
from nrs_cosim.orchestrator.cluster.coordinator import Coordinator
from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.cluster.remote_workers import PROCESS, Run, Worker, alone, digest_of, paper_file
from tests.guard import GUARD, LIMIT, VAIN
from tests.network.authority import Authority
from tests.network.cable import cable_to
from tests.network.ports import free_port
from tests.scenarios import PAPER_FILE

SHORT, LONG = 20, 200
"""Ticks."""


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return a short scenario and its digest in one process."""
    folder = tmp_path_factory.mktemp("short")
    file = read_scenario(paper_file(folder, SHORT))
    return file, alone(file, folder)


@pytest.fixture(scope="module")
def long(tmp_path_factory):
    """Return a scenario that is long enough to pause in, and its digest in one process."""
    folder = tmp_path_factory.mktemp("long")
    file = read_scenario(paper_file(folder, LONG))
    return file, alone(file, folder)


ROUTER = (
    sys.executable,
    "-c",
    """
import sys
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
session = open_session(Endpoints(listen=(sys.argv[1],), insecure_tcp=True))
print("open", flush=True)
sys.stdin.readline()
session.close()
""",
)


def test_workers_that_join_early_or_late_share_all_robots(short, meet, nrs, tmp_path):
    file, digest = short
    early = nrs("worker", "--insecure-tcp", "--connect", meet, "--name", "early", "--robots", "1-2")
    with Run(file, tmp_path / "run.mcap", listen=(meet,), expected=3) as run:
        run.until("waits for workers; missing: robots 1-6")
        run.until("early has joined with robots 1-2; missing: robots 3-6")
        others = [
            nrs("worker", "--insecure-tcp", "--connect", meet, "--name", name) for name in "bc"
        ]
        assert "with robots 3-4" in run.until("missing: robots 5-6")
        assert run.until("has joined with robots 5-6").endswith("robots 5-6")
        assert run.digest() == digest
    for worker in [early, *others]:
        status, printed = worker.end()
        assert status == 0
        assert "joined paper with robots" in printed


OLDER = """
import nrs_cosim.orchestrator.cluster.worker_client as worker_client
from nrs_cosim.orchestrator.cli.main import main
worker_client.version = lambda _: "0.0.1"
main()
"""


@pytest.fixture
def until_refused(monkeypatch):
    """Have a worker's time to look for a run be over once it was refused, each by itself."""
    here, rejected, clock = (
        threading.local(),
        worker_client._reason_to_wait,
        worker_client.monotonic,
    )

    def note(refusal):
        here.is_over = True
        return rejected(refusal)

    monkeypatch.setattr(worker_client, "_reason_to_wait", note)
    monkeypatch.setattr(
        worker_client, "monotonic", lambda: inf if getattr(here, "is_over", False) else clock()
    )


@pytest.mark.usefixtures("until_refused")
def test_refused_workers_are_told_why(short, meet, nrs, tmp_path):
    file, digest = short
    with Run(file, tmp_path / "run.mcap", listen=(meet,), expected=2) as run:
        good = Worker(meet, "good", (1, 2))
        run.until("good has joined")
        older = nrs(
            "worker",
            "--insecure-tcp",
            "--connect",
            meet,
            "--name",
            "x",
            program=(sys.executable, "-c", OLDER),
        )
        free = "--robots: robots 3-6 of 6 have no worker yet, but"
        for worker, kind, why in [
            (("a", (2, 3)), InputError, f"{free} this worker asks for robots 2-3"),
            (("b", (6, 7)), InputError, f"{free} this worker asks for robots 6-7"),
            (
                ("good",),
                RunError,
                f"within {GUARD:g} s: there is a worker of the name 'good' already",
            ),
            (("a/b",), InputError, "--name: expected the name of a worker"),
        ]:
            with pytest.raises(kind, match=re.escape(why)):
                Worker(meet, *worker).end()
        with pytest.raises(
            BusError, match=f"no connection within {VAIN} s: .* nothing listens there"
        ):
            Worker(f"tcp/127.0.0.1:{free_port()}", "c", wait=VAIN).end()
        status, printed = older.end()
        assert (status, "Traceback" in printed) == (1, False)
        assert "the worker of 0.0.1: install the same" in printed
        last = Worker(meet, "last")
        assert run.digest() == digest
    good.end()
    last.end()


BEYOND = [
    ["worker", "--connect"],
    ["run", str(PAPER_FILE), "--connect"],
    ["run", str(PAPER_FILE), "--listen"],
]


@pytest.mark.parametrize("command", BEYOND, ids=" ".join)
@pytest.mark.parametrize("address", ["10.77.0.9", "127.0.0.1", "localhost", "[::1]"])
def test_plain_tcp_without_its_option_is_refused_on_loopback_too(
    command, address, monkeypatch, capsys
):
    monkeypatch.setattr(sys, "argv", ["nrs", *command, f"tcp/{address}:7447"])
    with pytest.raises(SystemExit, match="2"):
        main()
    result = " ".join(capsys.readouterr().err.split())
    assert (
        f"{command[-1]}: 'tcp/{address}:7447' is plain TCP, where anyone who reaches it" in result
    )
    assert "--insecure-tcp" in result


def test_a_worker_chooses_between_two_runs_on_one_router(short, meet, nrs, tmp_path):
    file, digest = short
    router = nrs(meet, program=ROUTER)
    router.until("open")
    with (
        Run(file, tmp_path / "one.mcap", connect=(meet,)) as one,
        Run(file, tmp_path / "two.mcap", connect=(meet,)) as two,
    ):
        first, second = (run.until("waits for workers").split()[1] for run in (one, two))
        both = ", ".join(sorted([first, second]))
        with pytest.raises(RunError, match=f"--run: give one of the 2 runs here: {both}"):
            Worker(meet, "unsure").end()
        with pytest.raises(RunError, match="no run was found whose id begins with x"):
            Worker(meet, "wrong", run="x", looks=VAIN).end()
        workers = [Worker(meet, "both", run=first[:8]), Worker(meet, "both", run=second)]
        assert [one.digest(), two.digest()] == [digest, digest]
    for worker in workers:
        worker.end()


@pytest.mark.usefixtures("until_refused")
def test_a_killed_worker_is_waited_for_and_replaced(long, meet, nrs, tmp_path):
    file, digest = long
    with Run(file, tmp_path / "run.mcap", listen=(meet,), pauses=(100,)) as run:
        stays = Worker(meet, "stays", (1, 2, 4))
        dies = nrs(
            "worker", "--insecure-tcp", "--connect", meet, "--name", "dies", "--robots", "3,5-6"
        )
        run.until("paused at tick 100")
        dies.kill()
        run.go_on.set()
        gone = run.until("dies (robots 3, 5-6) is gone")
        assert "; waiting for it to come back; missing: worker dies" in gone
        with pytest.raises(RunError, match=r"take the place of dies \(robots 3, 5-6\) by --name"):
            Worker(meet, "other").end()
        again = nrs("worker", "--insecure-tcp", "--connect", meet, "--name", "dies")
        run.until("dies has joined with robots 3, 5-6")
        assert run.digest() == digest
    stays.end()
    assert again.end()[0] == 0


def test_a_worker_that_reconnects_after_the_end_is_told_that_the_run_is_over(
    short, meet, monkeypatch, tmp_path
):
    file, digest = short
    wait_for_ends, received = Coordinator._wait_for_ends, []

    def cut(self, is_enough):
        received.append(is_enough)
        if len(received) == 2:  # its report has come, and it does not understand what it is told
            cable.cut()
        wait_for_ends(self, is_enough)

    monkeypatch.setattr(Coordinator, "_wait_for_ends", cut)
    monkeypatch.setattr(coordinator, "END", b"?")
    with cable_to(int(meet.rpartition(":")[2])) as cable:
        with Run(file, tmp_path / "run.mcap", listen=(meet,)) as run:
            worker = Worker(cable.endpoint, "worker")
            assert run.digest() == digest
        worker.end()
    assert any(
        "the orchestrator is gone; looking for it again" in line for line in worker.all_lines()
    )


def test_without_restart_a_lost_worker_ends_the_run(long, meet, nrs, tmp_path):
    with Run(long[0], tmp_path / "x.mcap", listen=(meet,), pauses=(100,), restart=False) as run:
        stays = Worker(meet, "stays", (1, 2, 3, 4))
        dies = nrs(
            "worker", "--insecure-tcp", "--connect", meet, "--name", "dies", "--robots", "5-6"
        )
        run.until("paused")
        dies.kill()
        run.go_on.set()
        outcome = run.outcome()
    assert outcome.status == "failed"
    assert outcome.reason.startswith("worker dies (robots 5-6) is gone, after tick 1")
    stays.end()


def test_robots_without_a_worker_are_named(meet, nrs, tmp_path):
    path = paper_file(tmp_path, SHORT)
    run = nrs(
        "run", path, "--insecure-tcp", "--listen", meet, "--wait", "2", "-o", tmp_path / "x.mcap"
    )
    worker = Worker(meet, "some", (2, 3, 4, 5), looks=LIMIT, wait=LIMIT)
    status, printed = run.end()
    assert status == 1
    assert re.search("robots 1(, |-)6 had no worker for 2 s", printed)
    assert not (tmp_path / "x.mcap").exists()
    with pytest.raises(RunError, match=f"(no connection|not let into a run) within {LIMIT:g} s"):
        worker.end()


def test_workers_wait_for_a_killed_orchestrator_and_resume_uses_them(long, meet, nrs, tmp_path):
    _, digest = long
    cut, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    result = {"file": str(paper_file(tmp_path, LONG)), "output": str(cut)}
    run = nrs(json.dumps({**result, "listen": [meet], "pauses": [100]}), program=PROCESS)
    workers = [
        nrs("worker", "--insecure-tcp", "--connect", meet, "--name", name, "--robots", robots)
        for name, robots in (("left", "1-3"), ("right", "4-6"))
    ]
    run.until("paused at tick 100")
    run.kill()
    for worker in workers:
        worker.until("the orchestrator is gone; looking for it again")
    resumed = nrs("resume", cut, "--insecure-tcp", "--listen", meet, "-o", whole)
    assert resumed.end()[0] == 0
    assert [worker.end()[0] for worker in workers] == [0, 0]
    assert digest_of(whole) == digest


def test_with_tls_in_the_scenario_workers_get_the_robots_of_their_certificates(nrs, tmp_path):
    authority, meet = Authority(tmp_path), f"tls/127.0.0.1:{free_port()}"
    digest = alone(read_scenario(paper_file(tmp_path, SHORT)), tmp_path)
    authority.issue("orchestrator")
    tls = {
        "ca": "ca.pem",
        "certificate": "orchestrator.pem",
        "key": "orchestrator-key.pem",
        "workers": {"left": "1,3-5", "right": "2,6"},
    }
    path = paper_file(tmp_path, SHORT, {"bus.tls": tls})
    whole = tmp_path / "run.mcap"
    run = nrs("run", path, "--insecure-tcp", "--listen", meet, "-o", whole)
    workers = []
    for name in ("left", "right"):
        tls = authority.issue(name)
        options = ("--tls-ca", tls.ca, "--tls-certificate", tls.certificate, "--tls-key", tls.key)
        workers.append(nrs("worker", "--insecure-tcp", "--connect", meet, *options))
    assert [each.end()[0] for each in (run, *workers)] == [0, 0, 0]
    assert "joined paper with robots 1, 3-5" in workers[0].lines[0]
    assert digest_of(whole) == digest
