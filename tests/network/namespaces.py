"""Two machines on one: network namespaces joined by a link with delay, loss, and a switch.

    left 10.77.0.1  ── veth, tc netem ──  10.77.0.2 right

Making them needs rights; where these are missing the test is skipped, with the reason. Where the
kernel has no netem, a process carries the packets instead (`tests.network.relay`).
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.guard import GUARD

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True, slots=True)
class Machine:
    """One namespace: its name, the address that the other reaches it by, and its device."""

    name: str
    address: str
    device: str

    def command(self, *arguments: str | Path) -> list[str]:
        """Return a command that runs inside."""
        return ["ip", "netns", "exec", self.name, *map(str, arguments)]

    @contextmanager
    def start(self, *arguments: str | Path, **more: Any) -> Iterator[subprocess.Popen[str]]:
        """Yield a process inside, which finds this project's modules; it ends with the block."""
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        command = self.command(*arguments)
        with subprocess.Popen(command, env=environment, text=True, **more) as process:
            try:
                yield process
            finally:
                process.kill()

    @contextmanager
    def python(self, code: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
        """Yield Python code that runs inside, with pipes to talk to it by lines."""
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        with self.start(sys.executable, "-u", "-c", code, *arguments, **pipes) as process:
            yield process


@dataclass(frozen=True, slots=True)
class Wire:
    """The link between two machines."""

    left: Machine
    right: Machine

    def cut(self) -> None:
        """Cut it: nothing passes, and no connection over it is told."""
        _run("ip", "-n", self.left.name, "link", "set", self.left.device, "down")

    def mend(self) -> None:
        """Join it again after a cut."""
        _run("ip", "-n", self.left.name, "link", "set", self.left.device, "up")


@contextmanager
def two_machines(delay_ms: float = 0.0, loss_percent: float = 0.0) -> Iterator[Wire]:
    """Yield two machines on a wire; processes that still run inside are ended with them.

    Each direction is delayed by so many ms, and loses so many of its packets.
    """
    own = f"{os.getpid() % 100_000}"
    left = Machine(f"nrsl{own}", "10.77.0.1", f"nrl{own}")
    right = Machine(f"nrsr{own}", "10.77.0.2", f"nrr{own}")
    wire = Wire(left, right)
    with ExitStack() as stack:
        for end in (left, right):
            _try("ip", "netns", "add", end.name)
            stack.callback(_remove, end)
        poor = delay_ms > 0 or loss_percent > 0
        in_kernel = not poor or _has_netem(left)
        if in_kernel:
            peer = ("peer", "name", right.device, "netns", right.name)
            _try("ip", "link", "add", left.device, "netns", left.name, "type", "veth", *peer)
        else:
            stack.enter_context(_relayed(wire, delay_ms, loss_percent))
        for end in (left, right):
            _try("ip", "-n", end.name, "addr", "add", f"{end.address}/24", "dev", end.device)
            for device in ("lo", end.device):
                _try("ip", "-n", end.name, "link", "set", device, "up")
        if poor and in_kernel:
            for end in (left, right):
                how = ("netem", "delay", f"{delay_ms}ms", "loss", f"{loss_percent}%")
                _try(*end.command("tc", "qdisc", "add", "dev", end.device, "root", *how))
        yield wire


def _has_netem(end: Machine) -> bool:
    command = end.command("tc", "qdisc", "add", "dev", "lo", "root", "netem")
    if subprocess.run(command, check=False, capture_output=True).returncode:
        return False
    _run(*end.command("tc", "qdisc", "delete", "dev", "lo", "root"))
    return True


@contextmanager
def _relayed(wire: Wire, delay_ms: float, loss_percent: float) -> Iterator[None]:
    """Join two machines by a process that carries packets as long as the block goes on."""
    ends = (wire.left.name, wire.left.device, wire.right.name, wire.right.device)
    command = [sys.executable, "-m", "tests.network.relay", *ends, str(delay_ms), str(loss_percent)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, cwd=ROOT, text=True, **pipes) as process:
        try:
            if process.stdout.readline() != "joined\n":
                pytest.skip(f"neither netem nor TUN here: {process.stderr.read().splitlines()[-1]}")
            yield
        finally:
            process.kill()


def _run(*command: str) -> str:
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=GUARD)
    return done.stdout


def _try(*command: str) -> None:
    """Run what a machine may not allow or not have: the test is skipped then."""
    try:
        _run(*command)
    except FileNotFoundError as error:
        pytest.skip(f"no network namespaces here: {error}")
    except subprocess.CalledProcessError as error:
        pytest.skip(f"{' '.join(command)}: {error.stderr.strip()}")


def _remove(end: Machine) -> None:
    """End what runs inside a namespace of ours, and the namespace."""
    for pid in _run("ip", "netns", "pids", end.name).split():
        subprocess.run(["kill", "-9", pid], check=False, capture_output=True)
    _run("ip", "netns", "delete", end.name)
