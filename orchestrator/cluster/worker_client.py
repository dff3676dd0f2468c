"""The process of a worker: it joins a run, runs its robots in it, and leaves when the run ends.

It needs no scenario file: it is given the scenario, and knows FMUs by their content. When its link
or the orchestrator is gone, it forgets the run and asks to be let in again; what its robots did so
far is in the recording.
"""

import logging
from collections.abc import Callable, Collection, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from threading import Thread
from time import monotonic

from nrs_cosim.bus.encryption import KeyPair
from nrs_cosim.bus.errors import BusError, InputError, RunError
from nrs_cosim.bus.keys import (
    ALIVE,
    JOIN,
    ORCHESTRATOR,
    ORDERS,
    RECORDS,
    REPORT,
    SAMPLES,
    wire_key,
)
from nrs_cosim.bus.network.access import expect_worker_name
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Answer, Item, Presence
from nrs_cosim.orchestrator.cluster.fmu_finder import FmuFinder
from nrs_cosim.orchestrator.cluster.missed_samples import AbandonedError, EndedError, MissedSamples
from nrs_cosim.orchestrator.cluster.protocol import (
    Go,
    Hello,
    PlantDescription,
    Ready,
    Refusal,
    Report,
    Welcome,
)
from nrs_cosim.orchestrator.engine.robots import Robots, wire_of
from nrs_cosim.orchestrator.engine.worker import SENDS
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.orchestrator.scenario.robot_ids import named

_LOG = logging.getLogger(__name__)

_AGAIN = 0.5
"""s: how long to wait before a run is asked again."""


@dataclass(frozen=True, slots=True)
class JoinOptions:
    """How a worker joins."""

    name: str
    robots: Sequence[int] | None
    """The ones that it wants, ascending; None for any that are free."""
    run: str | None
    """How the id of the run begins, when several can be joined."""
    wait: float
    """s: how long to look for a run, or for one that is gone to come back."""
    allow_fmus: bool
    """Whether FMUs of the orchestrator may be run."""
    stays: bool
    """Whether to join again when the orchestrator is gone."""
    show: Callable[[str], None]
    """Is told in words what happens."""
    threads: int = 1
    """How many step its FMUs of which several may."""
    is_own: bool = False
    """Whether the orchestrator is the one that started it: its paths are the user's own."""


def serve(options: JoinOptions, endpoints: Endpoints) -> None:
    """Join a run, run robots in it until it ends.

    Raises `RunError` when there is no run in time, or the worker is not let in; `InputError` when
    its robots cannot be opened.
    """
    expect_worker_name(options.name, "--name")
    while True:
        bus = ZenohBus("*", endpoints)
        close = bus.close
        try:
            with ExitStack() as stack:
                welcome = _join_run(bus, options, endpoints.tls is not None)
                _run_assigned(stack, bus, options, welcome)
        except EndedError:
            return
        except AbandonedError as error:
            if not options.stays:
                return
            close = Thread(target=bus.close).start  # a cut link is waited for, some 10 s
            options.show(f"{error}; looking for it again")
        finally:
            close()


def _join_run(bus: ZenohBus, options: JoinOptions, tls: bool) -> Welcome:
    """Look for a run, and ask to be let in until it does."""
    inbox = bus.listen()
    robots = None if options.robots is None else tuple(options.robots)
    own = KeyPair()
    hello = Hello(
        version=version("nrs-cosim"), incarnation=bus.id, robots=robots, public=own.public
    ).written()
    present, join = wire_key(ALIVE, ORCHESTRATOR), wire_key(JOIN, options.name)
    until = monotonic() + options.wait
    last = "no run was found that waits for workers"
    if tls:
        last += (
            f"; if there is one, its bus.tls.workers may lack a certificate named {options.name}"
        )
    if options.run is not None:
        last = f"no run was found whose id begins with {options.run}; --run is of another"
    items: Sequence[Item] = ()
    while monotonic() < until:
        if not items:
            runs: set[str] = set()
            bus.look_for(present, inbox)
        items = inbox.take(_AGAIN)
        for item in items:
            if isinstance(item, Presence):
                runs.add(item.key.split("/")[1])
            elif item == Answer(present, None):
                if run := _chosen_run(runs, options.run or ""):
                    bus.run_id = run
                    bus.ask(join, hello, inbox)
            elif isinstance(item, Answer) and item.payload:
                note = _welcome_or_refusal(own, f"{bus.run_id}/{join}", item.payload)
                if isinstance(note, Welcome) and note.run == bus.run_id:
                    return note
                if isinstance(note, Refusal):
                    last = _reason_to_wait(note)
    raise RunError(f"not let into a run within {options.wait:g} s: {last}")


def _reason_to_wait(refusal: Refusal) -> str:
    """Return why a worker is not let in now; raises where asking again is of no use."""
    if refusal.over:
        raise EndedError(refusal.reason)
    if refusal.final:
        kind = InputError if refusal.reason.startswith("--") else RunError
        raise kind(f"not let into the run: {refusal.reason}")
    return refusal.reason


def _chosen_run(runs: Collection[str], begin: str) -> str | None:
    """Return the run that was meant, if it is there; `RunError` when it might be several."""
    meant = sorted(run for run in runs if run.startswith(begin) and "*" not in run)
    if len(meant) > 1:
        raise RunError(f"--run: give one of the {len(meant)} runs here: {', '.join(meant)}")
    return meant[0] if meant else None


def _welcome_or_refusal(own: KeyPair, where: str, data: bytes) -> Welcome | Refusal | None:
    welcome = own.decrypt(where, data)
    with suppress(BusError):
        return Refusal.read(data) if welcome is None else Welcome.read(welcome)
    return None


def _run_assigned(stack: ExitStack, bus: ZenohBus, options: JoinOptions, welcome: Welcome) -> None:
    """Open the robots, and run them from where the orchestrator says, until it ends the run."""
    name, signer = options.name, Signer(welcome.secret)
    report_key = wire_key(REPORT, name)
    put_report = bus.publisher(report_key)

    def report(note: Report) -> None:
        put_report(signer.sign(report_key, note.written()))

    options.show(f"joined {welcome.name} with {named(welcome.robots)}")
    _LOG.info("joined %s with %s", welcome.name, named(welcome.robots))
    inbox = bus.listen(wire_key(SAMPLES, "*"), wire_key(ORDERS, name))
    for kind in (SAMPLES, RECORDS):
        bus.publisher(wire_key(kind, name))  # before it asks to begin: see there
    bus.watch(wire_key(ALIVE, ORCHESTRATOR), inbox)
    bus.watch_links(inbox)
    bus.announce(wire_key(ALIVE, f"{name}/{bus.id}"))
    listening = MissedSamples(bus, inbox, name, signer)
    try:
        own = welcome.folder if options.is_own else None
        folder = Path(own) if own else Path("/nonexistent")
        assets = {field: note.asset(field) for field, note in welcome.assets.items()}
        file = parse_scenario(welcome.scenario, welcome.name, folder, welcome.name, assets)
        finder = FmuFinder(bus, welcome, folder, signer, options.is_own, options.allow_fmus)
        robots = Robots.opened(stack, file, welcome.robots, finder.find, options.threads)
    except InputError as error:
        report(Report(tick=-1, failed=str(error)))
        raise
    plants = tuple(PlantDescription.model_validate(plant) for plant in robots.plant_descriptions)
    go, checkpoints = Go.and_checkpoints(
        listening.ask_to_begin(Ready(incarnation=bus.id, plants=plants))
    )
    listening.wire = wire = wire_of(file, go.assignment, signer)
    listening.recorded = go.recorded
    worker = robots.worker(name, bus, inbox, wire)
    if go.start:
        worker.restore(go.start, checkpoints)
    k = go.start
    try:
        for k in worker.run(go.recorded, lambda _time: None, listening):  # noqa: B007
            pass
    except (AbandonedError, EndedError):
        raise
    except RunError as error:
        cause, place = replace(error.cause, tick=worker.now), worker.place
        if cause.robot is not None and place[1] >= SENDS:  # an algorithm's, of the whole worker
            place = *place[:2], cause.robot
        report(Report(tick=worker.now, failed=str(error), place=place, cause=cause))
    else:
        spent = worker.spent
        report(Report(tick=k, plants=spent.plants, bus=spent.bus, waiting=spent.waiting))
    listening.until_end()
