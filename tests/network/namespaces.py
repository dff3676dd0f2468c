"""Two machines on one: network namespaces joined by a link with delay, loss, and a switch.

    left 10.77.0.1  ── veth, tc netem ──  10.77.0.2 right

Making them needs rights, and delay and loss need the kernel's netem; where something is missing
the test that asks for it is skipped, with the reason.
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

    def shape(self, delay_ms: float = 0.0, loss_percent: float = 0.0) -> None:
        """Delay each direction by so many ms, and lose so many of its packets."""
        for end in (self.left, self.right):
            how = ("netem", "delay", f"{delay_ms}ms", "loss", f"{loss_percent}%")
            _try(*end.command("tc", "qdisc", "replace", "dev", end.device, "root", *how))

    def cut(self) -> None:
        """Cut it: nothing passes, and no connection over it is told."""
        _run("ip", "-n", self.left.name, "link", "set", self.left.device, "down")

    def mend(self) -> None:
        """Join it again after a cut."""
        _run("ip", "-n", self.left.name, "link", "set", self.left.device, "up")


@contextmanager
def two_machines(delay_ms: float = 0.0, loss_percent: float = 0.0) -> Iterator[Wire]:
    """Yield two machines on a wire; processes that still run inside are ended with them."""
    own = f"{os.getpid() % 100_000}"
    left = Machine(f"nrsl{own}", "10.77.0.1", f"nrl{own}")
    right = Machine(f"nrsr{own}", "10.77.0.2", f"nrr{own}")
    wire = Wire(left, right)
    with ExitStack() as stack:
        for end in (left, right):
            _try("ip", "netns", "add", end.name)
            stack.callback(_remove, end)
        peer = ("peer", "name", right.device, "netns", right.name)
        _try("ip", "link", "add", left.device, "netns", left.name, "type", "veth", *peer)
        for end in (left, right):
            _try("ip", "-n", end.name, "addr", "add", f"{end.address}/24", "dev", end.device)
            for device in ("lo", end.device):
                _try("ip", "-n", end.name, "link", "set", device, "up")
        if delay_ms or loss_percent:
            wire.shape(delay_ms, loss_percent)
        yield wire


def _run(*command: str) -> str:
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=30)
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
