"""How a run gets workers that are processes of their own, started here or coming from elsewhere."""

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from secrets import token_bytes
from uuid import uuid4

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.keys import FMU, JOIN, MISSED, ORDERS, RECORDS, REPORT, SAMPLES, START, wire_key
from nrs_cosim.bus.network.endpoints import Address, Endpoints
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Bus, Screen
from nrs_cosim.orchestrator.cluster.admission import Fmu
from nrs_cosim.orchestrator.cluster.coordinator import Coordinator
from nrs_cosim.orchestrator.cluster.local_worker import LocalWorker
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.lockstep import Launcher, Workers
from nrs_cosim.orchestrator.engine.plants import group_by_archive
from nrs_cosim.orchestrator.engine.worker import Watch
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.fmi.native.batch_calls import load_native
from nrs_cosim.plant_fmu.folders import own_folder

_ROBOTS_A_WORKER = 50
"""From so many robots on, a process more is worth what it costs."""


def local_workers(
    file: Experiment, workers: int, policy: WorkerPolicy, threads: int = 1
) -> Launcher:
    """The robots in several processes of this machine, which meet at a socket of the user's own.

    Each steps its FMUs with so many threads.
    """

    def launch(stack: ExitStack, _watch: Watch) -> tuple[Bus, Workers]:
        load_native()  # compiled once, before every worker looks for it
        folder = stack.enter_context(own_folder())
        endpoint = meeting_place(stack, folder)
        start = partial(LocalWorker, endpoint=endpoint, folder=folder, threads=threads)
        n = file.n
        robots = range(1, n + 1)
        assignment = {
            f"local-{i + 1}": robots[i * n // workers : (i + 1) * n // workers]
            for i in range(workers)
        }
        return _coordinator(stack, file, Endpoints(listen=(endpoint,)), assignment, policy, start)

    return launch


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


def remote_workers(
    file: Experiment,
    endpoints: Endpoints,
    assignment: Mapping[str, Sequence[int]],
    policy: WorkerPolicy,
) -> Launcher:
    """The robots on workers that join by themselves; `assignment` has those of known names."""

    def launch(stack: ExitStack, _watch: Watch) -> tuple[Bus, Workers]:
        return _coordinator(stack, file, endpoints, assignment, policy, None)

    return launch


def _coordinator(
    stack: ExitStack,
    file: Experiment,
    endpoints: Endpoints,
    assignment: Mapping[str, Sequence[int]],
    policy: WorkerPolicy,
    start: Callable[[str, Sequence[int]], LocalWorker] | None,
) -> tuple[Bus, Workers]:
    fmus = _fmus(file)
    bus = ZenohBus(uuid4().hex, endpoints)
    stack.callback(bus.close)
    batches = [wire_key(kind, "*") for kind in (SAMPLES, RECORDS, REPORT)]
    secret = token_bytes(32)
    if start:  # nobody but this user reaches the socket
        inbox = bus.listen_to_all()
    elif endpoints.listen:
        inbox = bus.listen_to_all(screen_of(Signer(secret)))
    else:
        inbox = bus.listen(*batches, screen=screen_of(Signer(secret)))
    coordinator = Coordinator(bus, inbox, file, fmus, assignment, policy, start, secret)
    stack.callback(coordinator.close)
    coordinator.gather()
    return bus, coordinator


def workers_worth_it(n: int) -> int:
    """Return into how many processes n robots are best spread on this machine."""
    return max(1, min(os.cpu_count() or 1, n // _ROBOTS_A_WORKER))


def _fmus(file: Experiment) -> Mapping[str, Fmu]:
    """Return the FMUs of a scenario, which are found but not loaded."""
    return {
        group.plant.fmu: Fmu(group.archive.sha256, group.archive.path.read_bytes)
        for group in group_by_archive(file)
    }


_LONGEST_HELLO = 2**20
"""Bytes of what a worker says to be let in, which is the one thing that is not signed."""
_ASKED = (START, MISSED, FMU)
_SEALED = (SAMPLES, RECORDS, REPORT, ORDERS, *_ASKED)


def screen_of(signer: Signer) -> Screen:
    """Return what keeps of all that comes only what is signed in the run, and short questions."""

    def screen(key: str, payload: bytes) -> str | None:
        kind = key.partition("/")[0]
        if kind == JOIN:
            return kind if len(payload) > _LONGEST_HELLO else None
        if kind not in _SEALED:
            return "key"
        if signer.verify(key, payload) is not None:
            return None
        return kind if kind in _ASKED else "signature"

    return screen
