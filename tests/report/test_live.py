"""A run is watched while it goes on, by its own machine alone, and is none the worse for it."""

import json
import logging
import os
import re
import signal
import socket
import struct
import subprocess
import sys
from contextlib import ExitStack
from http.client import HTTPConnection
from threading import Event, Thread

import pytest
from typer.testing import CliRunner

from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.engine.pace import RealTime
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.report.foxglove import Foxglove
from nrs_cosim.orchestrator.report.live import Live
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report import server as server_module
from nrs_cosim.recordings.report.server import LiveServer
from tests.guard import GUARD
from tests.scenarios import SCENARIOS

nrs = CliRunner()
FIRST_ORDER = SCENARIOS / "paper_first_order.toml"


class Run:
    """`nrs run --live` in a process of its own."""

    def __init__(self, *options):
        command = [
            sys.executable,
            "-m",
            "nrs_cosim.orchestrator",
            "run",
            str(FIRST_ORDER),
            *options,
        ]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        line = self.process.stderr.readline()
        (self.address,) = re.findall(r"http://127\.0\.0\.1:\d+/", line)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()


def test_a_browser_follows_a_live_run_to_its_end(chromium, tmp_path):
    from tests.report.browser import Look  # noqa: PLC0415, needs selenium

    out = tmp_path / "live.mcap"
    with Run("-o", str(out), "--live", "--realtime", "0.3") as live:
        look = Look(chromium, live.address).ready()
        assert "running" in look.ask("document.querySelector('#words').innerText")
        look.until("document.querySelectorAll('.panel .plot .trace').length >= 8 * 6")
        points = [n for _, n, _ in look.drawn()]
        assert len(points) == 12
        assert all(n > 0 for n in points)
        look.until(f"document.querySelector('.plot').data[0].x.length * 7 > {points[0]}")
        progress = look.ask("document.querySelector('#progress').value")
        assert 0 < progress < look.ask("document.querySelector('#progress').max") == 300
        look.until("document.querySelector('#left').innerText.includes('of 30 s simulated, about')")
        first = look.now()
        look.until(f"Number(document.querySelector('#slider').value) > {first}")
        assert first > 0  # nobody has touched the slider: the picture follows the run
        look.ask("document.querySelector('#play').click()")
        look.until("!picture.following && picture.now > 0")
        os.kill(live.process.pid, signal.SIGINT)
        look.until("document.querySelector('#live').innerText.includes('interrupted')")
        assert live.process.wait(GUARD) == 130
        assert not look.complaints()


def test_the_page_stays_until_ctrl_c(paper, tmp_path):
    out = tmp_path / "stay.mcap"
    with Run("-o", str(out), "--live", "--stay") as live:
        while "stays until Ctrl-C" not in live.process.stderr.readline():
            pass
        status, version, shown = get(live.address, "/data.json")
        assert (status, bool(version)) == (200, True)
        assert json.loads(shown)["runs"][0]["status"] == "completed"
        os.kill(live.process.pid, signal.SIGINT)
        assert live.process.wait(GUARD) == 0
    with pytest.raises(ConnectionRefusedError):
        get(live.address, "/")
    with Reader(out) as mine, Reader(paper) as other:
        assert mine.digest == other.digest


def test_an_old_recording_of_the_same_name_is_not_shown(tmp_path):
    out = tmp_path / "again.mcap"
    out.write_bytes(b"")
    with Run("-o", str(out), "--live", "--realtime", "0.01") as live:
        status, _, shown = get(live.address, "/data.json")
        assert status == 204 or json.loads(shown)["runs"][0]["status"] == "unfinished"
        os.kill(live.process.pid, signal.SIGINT)
        assert live.process.wait(GUARD) == 130
    with Reader(out) as reader:
        assert reader.status == "interrupted"


@pytest.mark.parametrize(
    ("view", "what"), [(Live(0, stay=False), "page"), (Foxglove(0), "Foxglove server")]
)
def test_a_dead_server_leaves_the_run_and_is_reported(tmp_path, capsys, view, what):
    if isinstance(view, Foxglove):
        pytest.importorskip("foxglove", reason="needs foxglove-sdk, of the extra `foxglove`")
    with view as live:
        live.begin(tmp_path / "a.mcap", tmp_path / "a.mcap")
        live.process.kill()
    assert live.process.returncode == -signal.SIGKILL
    assert f"warning: the process of the {what} was killed (SIGKILL)" in capsys.readouterr().err


def get(address, path, **headers):
    host = re.findall(r"//(.*)/", address)[0]
    connection = HTTPConnection(host, timeout=GUARD)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.getheader("X-Version"), answer.read()
    finally:
        connection.close()


@pytest.fixture
def served():
    """Return an address, and what is told there."""
    state = {"version": "", "answer": b"{}", "asked": 0, "on_asked": lambda: None}

    def tell():
        state["asked"] += 1
        state["on_asked"]()
        return state["answer"]

    listening = socket.create_server(("127.0.0.1", 0))
    with LiveServer(listening, lambda: state["version"], tell) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/", state, server
        server.shutdown()
        thread.join()


def test_known_data_is_not_sent_again(served):
    address, state, server = served
    assert get(address, "/data.json")[0] == 204
    state["version"] = "a"
    assert get(address, "/data.json") == (200, "a", b"{}")
    assert get(address, "/data.json?since=a")[0] == 204
    assert state["asked"] == 1
    server.linger(0.0)
    state["version"], state["answer"] = "b", b"[]"
    assert get(address, "/data.json?since=a") == (200, "b", b"[]")


def silent(address):
    """Return a connection that asks nothing."""
    host, port = re.findall(r"http://(.*):(\d+)/", address)[0]
    return socket.create_connection((host, int(port)), timeout=GUARD)


def test_connections_beyond_the_limit_are_closed(served):
    address, *_ = served
    with ExitStack() as stack:
        held = [stack.enter_context(silent(address)) for _ in range(server_module.MOST)]
        assert stack.enter_context(silent(address)).recv(1) == b""
        held[0].sendall(b"x\r\n\r\n")
        assert b"Error response" in held[0].recv(200)


def test_a_silent_connection_is_closed(served, monkeypatch):
    address, *_ = served
    monkeypatch.setattr(server_module._Answer, "timeout", 0.05)
    with silent(address) as quiet:
        assert quiet.recv(1) == b""


def test_a_browser_tab_closed_early_is_only_logged(served, capfd):
    address, state, _ = served
    logged = Event()
    handler = logging.Handler()
    handler.emit = lambda record: record.exc_info and logged.set()
    logger = logging.getLogger("nrs_cosim.recordings.report.server")
    tab = silent(address)
    tab.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close: reset
    state["version"], state["on_asked"] = "a", tab.close
    logger.addHandler(handler)
    logger.setLevel("INFO")
    try:
        tab.sendall(f"GET /data.json HTTP/1.1\r\nHost: {address[7:-1]}\r\n\r\n".encode())
        assert logged.wait(GUARD)
    finally:
        logger.removeHandler(handler)
        logger.setLevel("NOTSET")
    assert capfd.readouterr().err == ""


def test_only_requests_to_this_machines_names_are_answered(served):
    address, *_ = served
    assert get(address, "/")[0] == 200
    assert get(address, "/", Host="evil.example")[0] == 403
    assert get(address, "/data.json", Host="evil.example")[0] == 403
    assert get(address, "/etc/passwd")[0] == 404


def test_simulated_time_does_not_pass_faster_than_asked():
    wall, naps = [100.0], []

    def pause(seconds):
        naps.append(seconds)
        wall[0] += seconds

    pace = RealTime(2.0, lambda: wall[0], pause)
    pace.start(3_000_000_000)
    asked = []
    pace.wait(3_000_000_000, lambda: asked.append(wall[0]))
    assert not naps
    pace.wait(4_000_000_000, lambda: asked.append(wall[0]))
    assert wall[0] == pytest.approx(100.5)
    assert max(naps) <= 0.1
    assert len(asked) == len(naps)
    wall[0] = 200.0
    pace.wait(5_000_000_000, lambda: asked.append(wall[0]))
    assert wall[0] == 200.0


class Counting:
    """A pace that notes what it is asked."""

    asked = 1.0

    def __init__(self):
        self.started, self.times = [], []

    def start(self, time_ns):
        self.started.append(time_ns)

    def wait(self, time_ns, ask):
        self.times.append(time_ns)
        ask()


def test_a_pace_is_asked_before_each_tick_and_changes_no_bit(paper, tmp_path):
    pace = Counting()
    path = run(read_scenario(FIRST_ORDER), tmp_path / "paced.mcap", pace=pace).path
    assert pace.started == [0]
    assert pace.times == [k * 100_000_000 for k in range(301)]
    with Reader(path) as mine, Reader(paper) as other:
        assert mine.digest == other.digest


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--realtime", "0"], "--realtime: expected a number above 0, got 0"),
        (["--realtime", "nan"], "--realtime: expected a number, got 'nan'"),
        (["--port", "80"], "--port requires --live"),
        (["--stay"], "--stay requires --live"),
    ],
)
def test_contradictory_live_options_are_refused(options, said):
    assert said in str(nrs.invoke(app, ["run", str(FIRST_ORDER), *options]).exception)


def test_a_port_in_use_is_named(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = str(other.getsockname()[1])
        out = str(tmp_path / "run.mcap")
        options = ["run", str(FIRST_ORDER), "-o", out, "--live", "--port", port]
        result = nrs.invoke(app, options)
        assert f"--port {port}: Address already in use" in str(result.exception)
