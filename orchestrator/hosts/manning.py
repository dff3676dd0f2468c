"""How a run gets hosts that are processes of their own, started here or coming from elsewhere."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from secrets import token_bytes
from uuid import uuid4

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.keys import RECORDS, REPORT, SAMPLES, wire_key
from nrs_cosim.bus.network.endpoints import Address, Endpoints
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.seal import Seal
from nrs_cosim.bus.transport import Bus
from nrs_cosim.orchestrator.hosts.crew import Crew, Fmu, Terms, screen_of
from nrs_cosim.orchestrator.hosts.local import LocalHost
from nrs_cosim.orchestrator.runs.host import Watch
from nrs_cosim.orchestrator.runs.lockstep import Hosts, Manning
from nrs_cosim.orchestrator.runs.plants import group_by_archive
from nrs_cosim.orchestrator.scenario.clock import Clock
from nrs_cosim.orchestrator.scenario.file import ScenarioFile
from nrs_cosim.plant_fmu.fmi.native.rounds import load_native
from nrs_cosim.plant_fmu.folders import own_folder

_ROBOTS_A_HOST = 50
"""From so many robots on, a process more is worth what it costs."""


@dataclass(frozen=True, slots=True)
class Handling:
    """What is done about hosts that come and go."""

    restart: bool
    """Whether the run goes on without one that is gone."""
    wait: float
    """s: how long a robot may be without a host."""
    show: Callable[[str], None]
    """Is told in words who comes and goes."""
    expected: int = 1
    """How many hosts share the robots, when they do not say which they want."""


def here(file: ScenarioFile, hosts: int, handling: Handling) -> Manning:
    """The robots in several processes of this machine, which meet at a socket of the user's own."""

    def man(stack: ExitStack, _clock: Clock, _watch: Watch) -> tuple[Bus, Hosts]:
        load_native()  # compiled once, before every host looks for it
        folder = stack.enter_context(own_folder())
        endpoint = meeting_place(stack, folder)
        start = partial(LocalHost, endpoint=endpoint, folder=folder)
        n = file.scenario.n
        robots = range(1, n + 1)
        homes = {
            f"local-{i + 1}": robots[i * n // hosts : (i + 1) * n // hosts] for i in range(hosts)
        }
        return _crew(stack, file, Endpoints(listen=(endpoint,)), homes, handling, start)

    return man


def meeting_place(stack: ExitStack, folder: Path) -> str:
    """Return an endpoint in a folder of this user's alone, for which the stack may make another.

    A socket's path is short and has no sign that means something in an endpoint, which a folder for
    temporary files need not mind: clusters give long ones.
    """
    for place in (None, os.environ.get("XDG_RUNTIME_DIR"), "/tmp"):
        with suppress(InputError, OSError):
            own = folder if place is None else stack.enter_context(own_folder(place))
            return Address.of("TMPDIR", f"unixsock-stream/{own}/bus").text
    raise InputError(
        f"TMPDIR: a socket cannot be in {folder.parent}, nor in XDG_RUNTIME_DIR or /tmp: give a "
        "folder with a short name of letters and digits"
    )


def elsewhere(
    file: ScenarioFile,
    endpoints: Endpoints,
    homes: Mapping[str, Sequence[int]],
    handling: Handling,
) -> Manning:
    """The robots on hosts that join by themselves; `homes` are those whose names are known."""

    def man(stack: ExitStack, _clock: Clock, _watch: Watch) -> tuple[Bus, Hosts]:
        return _crew(stack, file, endpoints, homes, handling, None)

    return man


def _crew(
    stack: ExitStack,
    file: ScenarioFile,
    endpoints: Endpoints,
    homes: Mapping[str, Sequence[int]],
    handling: Handling,
    start: Callable[[str, Sequence[int]], LocalHost] | None,
) -> tuple[Bus, Hosts]:
    fmus = _fmus(file)
    bus = ZenohBus(uuid4().hex, endpoints)
    stack.callback(bus.close)
    batches = [wire_key(kind, "*") for kind in (SAMPLES, RECORDS, REPORT)]
    secret = token_bytes(32)
    if start:  # nobody but this user reaches the socket
        inbox = bus.listen_to_all()
    elif endpoints.listen:
        inbox = bus.listen_to_all(screen_of(Seal(secret)))
    else:
        inbox = bus.listen(*batches, screen=screen_of(Seal(secret)))
    terms = Terms(handling.expected, start, handling.restart, handling.wait, handling.show)
    crew = Crew(bus, inbox, file, fmus, homes, terms, secret)
    stack.callback(crew.close)
    crew.gather()
    return bus, crew


def hosts_worth_it(n: int) -> int:
    """Return into how many processes n robots are best spread on this machine."""
    return max(1, min(os.cpu_count() or 1, n // _ROBOTS_A_HOST))


def _fmus(file: ScenarioFile) -> Mapping[str, Fmu]:
    """Return the FMUs of a scenario, which are found but not loaded."""
    return {
        group.plant.fmu: Fmu(group.archive.sha256, group.archive.path.read_bytes)
        for group in group_by_archive(file.scenario, file.folder)
    }
