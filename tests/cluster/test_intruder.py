"""What strangers put, answer, ask and pretend changes no bit of a run, and ends nobody."""

import random
from dataclasses import replace

import numpy as np
import pytest
import zenoh

from nrs_cosim.bus.encryption import encrypt
from nrs_cosim.bus.errors import BusError, InputError, RunError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.validation import Tick
from nrs_cosim.orchestrator.cluster.protocol import Go, Hello, Ready, Refusal, Report, Welcome
from nrs_cosim.orchestrator.engine.robots import wire_of
from tests.cluster.intruder import ASSIGNMENT, fixture_of_a_run_alone, intruded
from tests.cluster.remote_workers import Run, Worker
from tests.guard import GUARD, VAIN
from tests.network.authority import Authority

PAUSE, TICKS = 50, 100
QUESTIONS = {"start", "missed", "fmu", "question"}
"""Reasons of refusals that are not of messages that were put."""
GARBAGE = [
    b"",
    b"\xff\xfe",
    b"{}",
    b"[" * 100_000,
    b'{"version": 1e999, "incarnation": null}',
    random.Random(1).randbytes(500),
    b"\x00" * 2**16,
]


run_alone = fixture_of_a_run_alone(TICKS)


def forged(file, intercepted):
    """Yield keys and messages that nobody is to believe."""
    stranger = wire_of(file, ASSIGNMENT, Signer(b"guessed"))
    unsigned = wire_of(file, ASSIGNMENT, Signer())
    genuine, records = intercepted["samples/left"], intercepted["records/left"]
    later = PAUSE + 5
    times = stranger.times
    for wire in (stranger, unsigned):
        for worker in ("left", "target"):
            nodes = np.array(ASSIGNMENT.get(worker, (0,)))
            samples = wire.samples.blank(nodes)
            samples["k"], samples["time_ns"] = later, times.t(later)
            yield f"samples/{worker}", wire.pack_samples(worker, later, samples)
            yield f"samples/{worker}", wire.pack_samples(worker, later + 1, samples)
            samples["position"] = np.nan
            yield f"samples/{worker}", wire.pack_samples(worker, later, samples)
        nodes = np.tile(np.array(ASSIGNMENT["left"]), len(times.outputs(later)))
        tick = Tick(wire.states.blank(nodes), wire.none, ())
        yield "records/left", wire.pack_tick("left", later, tick)
    failed = Report(tick=1, failed="so it says").written()
    for worker in ("left", "right", "nobody"):
        key = f"report/{worker}"
        yield key, Signer(b"guessed").sign(key, failed)
        yield f"orders/{worker}", Signer(b"guessed").sign(f"orders/{worker}", b"end")
        yield f"orders/{worker}", b"end"
        yield key, failed
    flipped = genuine[:-1] + bytes([genuine[-1] ^ 1])
    for key in ("samples/right", "samples/target", "records/left", "samples/nobody", "report/left"):
        yield key, genuine
        yield key, records if key != "records/left" else records[:-1]
    for payload in (genuine[:-1], genuine[:16], genuine + b"\0", flipped, *GARBAGE):
        yield "samples/left", payload
    for key in ("records/right", "report/right", "orders/right", "samples/a/b", "any/thing"):
        yield from ((key, payload) for payload in GARBAGE[:3])
    for key in ("/other/samples/left", "/*/samples/left", "/*/orders/*", "/**", "/x"):
        yield key, genuine


def test_forged_and_damaged_messages_are_counted_and_nothing_else(run_alone, meet, tmp_path):
    file, digest = run_alone
    with intruded(file, tmp_path, meet, pauses=(10, PAUSE)) as (run, intruder):
        workers = [Worker(meet, name, robots) for name, robots in ASSIGNMENT.items()]
        run.until("paused at tick 10")
        run.go_on.set()
        run.until(f"paused at tick {PAUSE}")
        for key, payload in forged(file, intruder.intercepted):
            intruder.put(key, payload)
        put = intruder.count()
        run.go_on.set()
        assert run.digest() == digest
        for worker in workers:
            worker.end()
    assert put > 50
    rejected = run.outcome().rejected
    assert {why: n for why, n in rejected.items() if why in QUESTIONS} == {}
    assert sum(rejected.values()) == put


def test_queries_and_presence_of_strangers_change_nothing(run_alone, meet, tmp_path):
    file, digest = run_alone
    with intruded(file, tmp_path, meet, pauses=(PAUSE,)) as (run, intruder):
        seen = []
        intruder.session.liveliness().declare_subscriber(
            "nrs/*/alive/*/*", lambda sample: seen.append(str(sample.key_expr))
        )
        for name in ("a b/c", "target", "orchestrator", "x\n", " "):
            for payload in GARBAGE:
                intruder.ask(f"join/{name}", payload, VAIN) if payload == b"{}" else None
        for payload in GARBAGE:
            (answer,) = intruder.ask("join/stranger", payload)
            assert Refusal.read(answer).final
        workers = [Worker(meet, name, robots) for name, robots in ASSIGNMENT.items()]
        run.until(f"paused at tick {PAUSE}")
        incarnation = seen[0].rpartition("/")[2]
        tokens = [
            intruder.session.liveliness().declare_token(intruder.prefix + key)
            for key in (
                *(f"alive/{'/'.join(key.split('/')[3:])}" for key in seen),
                *("alive/orchestrator", "alive/x", "alive/left/x", "alive/a/b/c", "alive/*/*"),
                "**",
            )
        ]
        ready = Ready(incarnation=incarnation, plants=()).written()
        replies = [
            intruder.session.get(intruder.prefix + key, payload=payload, timeout=GUARD)
            for key in ("start/left", "missed/left", "missed/x", "fmu/x", "join/left", "**")
            for payload in (*GARBAGE, ready, b"\xff\xff\xff\xff", b"\x01\x00\x00\x00")
        ]
        for token in tokens:
            token.undeclare()
        intruder.count()
        run.go_on.set()
        for reply in replies:
            assert not [r for r in reply if r.ok and b"secret" in r.ok.payload.to_bytes()]
        assert run.digest() == digest
        for worker in workers:
            worker.end()
    assert run.outcome().rejected["start"] >= len(GARBAGE)
    assert run.outcome().rejected["missed"] >= 2 * len(GARBAGE)


def test_forged_answers_are_ignored(run_alone, meet, nrs, tmp_path):
    file, digest = run_alone
    with intruded(file, tmp_path, meet, pauses=(PAUSE,)) as (run, intruder):
        asked = []

        def lie(query):
            asked.append(str(query.key_expr).removeprefix(intruder.prefix))
            query.reply_err(b"no")
            go = Go(assignment=ASSIGNMENT, start=7, recorded=-1).with_checkpoints([])
            for answer in (*GARBAGE[:-1], go):
                query.reply(query.key_expr, answer)
            query.drop()

        for kind in ("start", "missed", "fmu"):
            intruder.session.declare_queryable(f"nrs/*/{kind}/*", lie)
        stays = Worker(meet, "left", ASSIGNMENT["left"])
        dies = nrs(
            "worker",
            "--insecure-tcp",
            "--connect",
            meet,
            "--name",
            "right",
            "--robots",
            "4-6",
        )
        run.until("paused")
        dies.kill()
        run.go_on.set()
        run.until("right (robots 4-6) is gone")
        again = Worker(meet, "right")
        assert run.digest() == digest
        stays.end()
        again.end()
    assert {"start/left", "start/right", "missed/right"} <= {*asked}


@pytest.fixture
def tls(tmp_path):
    """Return certificates by name, of which the run's authority issued all but the foreign one."""
    authority, foreign = Authority(tmp_path / "own"), Authority(tmp_path / "foreign")
    names = ("orchestrator", "left", "right", "unlisted")
    return {**{n: authority.issue(n) for n in names}, "foreign": foreign.issue("left")}


def test_with_tls_only_listed_workers_join_each_with_its_robots(run_alone, address, tls, tmp_path):
    file, digest = run_alone
    listen = (f"tls/{address}",)
    with Run(
        file, tmp_path / "run.mcap", assignment=ASSIGNMENT, listen=listen, tls=tls["orchestrator"]
    ) as run:
        run.until("waits for workers; missing: worker left, worker right")
        for name, certificate, kind, why in [
            ("left", "foreign", InputError, "its certificate is refused here"),
            ("unlisted", "unlisted", RunError, "its bus.tls.workers may lack .* named unlisted"),
            ("left", "right", RunError, "no run was found"),
        ]:
            waits = {"wait": VAIN} if kind is InputError else {"looks": VAIN}
            with pytest.raises(kind, match=why):
                Worker(listen[0], name, tls=tls[certificate], **waits).end()
        trusting = replace(tls["foreign"], ca=tls["left"].ca)
        with pytest.raises(InputError, match="refused: it does not know the authority"):
            Worker(listen[0], "left", tls=trusting, wait=VAIN).end()
        with pytest.raises(InputError, match="needs certificates"):
            Worker(listen[0], "left")
        with pytest.raises(BusError):
            Worker(f"tcp/{address}", "left", wait=VAIN).end()
        with pytest.raises(InputError, match="--robots: 'left' has robots 1-3 in this run, not ro"):
            Worker(listen[0], "left", (1, 2), tls=tls["left"]).end()
        workers = [Worker(listen[0], name, tls=tls[name]) for name in ASSIGNMENT]
        assert run.digest() == digest
    for worker in workers:
        worker.end()
    assert not run.outcome().rejected


def test_with_tls_a_worker_cannot_send_for_another(run_alone, address, tls, tmp_path):
    file, digest = run_alone
    listen = (f"tls/{address}",)
    ends = {"listen": listen, "tls": tls["orchestrator"]}
    with Run(file, tmp_path / "run.mcap", assignment=ASSIGNMENT, pauses=(PAUSE,), **ends) as run:
        id_ = run.until("waits for workers").split()[1]
        client = Endpoints(connect=listen, tls=tls["right"])
        with open_session(client) as lurer, open_session(client) as session:
            lured = []
            lurer.declare_queryable("nrs/**", lambda query: lured.append(str(query.key_expr)))
            token = lurer.liveliness().declare_token(f"nrs/{'0' * 32}/alive/orchestrator")
            workers = [Worker(listen[0], name, tls=tls[name]) for name in ASSIGNMENT]
            run.until("paused")
            for kind in ("samples", "records", "report", "orders"):
                for name in ("left", "target", "nobody", "right"):
                    session.put(
                        f"nrs/{id_}/{kind}/{name}",
                        b"forged",
                        congestion_control=zenoh.CongestionControl.BLOCK,
                    )
            for key in ("join/left", "start/left", "missed/left", "orders/right"):
                assert list(session.get(f"nrs/{id_}/{key}", payload=b"", timeout=VAIN)) == []
            run.go_on.set()
            assert run.digest() == digest
            for worker in workers:
                worker.end()
            token.undeclare()
    assert lured == []
    assert run.outcome().rejected == {"signature": 3}  # right's own samples, records and report


def test_on_plain_tcp_an_impostor_orchestrator_cannot_crash_a_worker(meet):
    with open_session(Endpoints(listen=(meet,), insecure_tcp=True)) as session:
        run = "0" * 32
        token = session.liveliness().declare_token(f"nrs/{run}/alive/orchestrator")
        answers = iter([*GARBAGE, Refusal(reason="because", final=True).written()])

        encrypting = []

        def lie(query):
            for answer in answers:
                query.reply(query.key_expr, answer)
            for welcome in encrypting:
                public = Hello.read(query.payload.to_bytes()).public
                query.reply(query.key_expr, encrypt(public, f"{run}/join/left", welcome))
            query.drop()

        session.declare_queryable("nrs/*/join/*", lie)
        with pytest.raises(RunError, match="not let into the run: because"):
            Worker(meet, "left").end()
        welcome = Welcome(
            run=run,
            secret=b"x" * 32,
            name="lure",
            scenario="no = [",
            assets={},
            folder=None,
            fmus={},
            robots=(1,),
        ).written()
        answers = iter([])
        encrypting.append(welcome)
        with pytest.raises(InputError, match="lure"):
            Worker(meet, "left").end()
        token.undeclare()
