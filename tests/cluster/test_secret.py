"""A run's secret is told to the worker that asked to join, and to nobody who repeats its words."""

from importlib.metadata import version

import numpy as np
import zenoh

from nrs_cosim.bus.encryption import KeyPair
from nrs_cosim.bus.signature import Signer
from nrs_cosim.orchestrator.cluster import launcher
from nrs_cosim.orchestrator.cluster.protocol import Hello, Refusal, Welcome
from nrs_cosim.orchestrator.engine.lockstep import MOST_WINDOW
from nrs_cosim.orchestrator.engine.robots import wire_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.cluster.intruder import ASSIGNMENT, Intruder, fixture_of_a_run_alone, intruded
from tests.cluster.remote_workers import Worker, paper_file
from tests.guard import GUARD

PAUSE, TICKS = 20, 40

run_alone = fixture_of_a_run_alone(TICKS)


def hello(public, incarnation="its-session", robots=ASSIGNMENT["left"]):
    """Return what a worker says to be let in."""
    result = {"version": version("nrs-cosim"), "incarnation": incarnation, "robots": robots}
    return Hello(**result, public=public).written()


def ask(intruder, key, payload):
    """Ask, and return where all answers come."""
    return intruder.session.get(intruder.prefix + key, payload=payload, timeout=GUARD)


def answers(replies):
    """Return all answers; a question that is not answered ends with the run."""
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok]


def asked(intruder, key, payload):
    """Ask what is answered, and return all answers."""
    return answers(ask(intruder, key, payload))


def test_a_replayed_join_request_is_rejected_and_counted(run_alone, meet, tmp_path):
    file, digest = run_alone
    with intruded(file, tmp_path, meet, pauses=(PAUSE,)) as (run, intruder):
        said = {}

        def intercept(query):
            said[str(query.key_expr).rpartition("/")[2]] = query.payload.to_bytes()
            query.drop()

        intruder.session.declare_queryable("nrs/*/join/*", intercept)
        workers = [Worker(meet, name, robots) for name, robots in ASSIGNMENT.items()]
        run.until("paused")
        assert said.keys() == ASSIGNMENT.keys()
        own, replies = KeyPair(), []
        for name, words in said.items():
            theirs = Hello.read(words)
            altered = theirs.model_copy(update={"public": own.public}).written()
            anew = theirs.model_copy(update={"robots": None}).written()
            key = f"join/{name}"
            replies += [ask(intruder, key, payload) for payload in (words, altered, anew)]
        intruder.count()
        run.go_on.set()
        assert run.digest() == digest
        assert [answers(each) for each in replies] == [[]] * len(replies)
        for worker in workers:
            worker.end()
    # The one that was counted by is refused too.
    assert run.outcome().rejected == {"join": 3 * len(ASSIGNMENT), "key": 1}


def test_a_welcome_is_resent_to_its_worker_and_only_that_worker_reads_it(run_alone, meet, tmp_path):
    file, digest = run_alone
    with (
        intruded(file, tmp_path, meet, expected=2) as (run, one),
        Intruder(meet, one.run) as thief,
    ):
        own, other, where = KeyPair(), KeyPair(), f"{one.run}/join/left"
        words = hello(own.public)
        (answer,) = asked(one, "join/left", words)
        welcome = Welcome.read(own.decrypt(where, answer))
        assert (welcome.run, welcome.robots) == (one.run, ASSIGNMENT["left"])
        assert asked(one, "join/left", words) == [answer]
        assert asked(thief, "join/left", words) == [answer]
        for hidden in (welcome.secret, welcome.secret.hex().encode(), b"paper", b"sampling"):
            assert hidden not in answer
        assert other.decrypt(where, answer) is None
        stolen = ask(thief, "join/left", hello(other.public))
        (refusal,) = asked(thief, "join/left", hello(other.public, "another-session"))
        assert "there is a worker of the name" in Refusal.read(refusal).reason
        known = words.replace(own.public.hex().encode(), b"0" * 64)
        (refusal,) = asked(thief, "join/right", known)
        assert "public key is not an X25519 key" in Refusal.read(refusal).reason

        def replay(query):
            query.reply(query.key_expr, answer)
            query.drop()

        thief.session.declare_queryable("nrs/*/join/*", replay)
        alive = f"nrs/{one.run}/alive/left/its-session"
        seen = one.session.liveliness().declare_subscriber(alive, zenoh.handlers.FifoChannel(9))
        token = one.session.liveliness().declare_token(alive)
        assert seen.recv().kind == zenoh.SampleKind.PUT
        token.undeclare()
        run.until("left (robots 1-3) is gone")
        workers = [Worker(meet, name, robots) for name, robots in ASSIGNMENT.items()]
        assert run.digest() == digest
        assert answers(stolen) == []
        for worker in workers:
            worker.end()
    assert run.outcome().rejected == {"join": 1}


def test_a_forger_with_the_secret_ends_the_run_and_is_named_as_a_cause(meet, tmp_path, monkeypatch):
    file = read_scenario(paper_file(tmp_path, PAUSE + 2 * MOST_WINDOW))
    monkeypatch.setattr(launcher, "token_bytes", lambda size: b"s" * size)
    with intruded(file, tmp_path, meet, pauses=(PAUSE,)) as (run, forger):
        workers = [Worker(meet, name, robots) for name, robots in ASSIGNMENT.items()]
        run.until("paused")
        wire = wire_of(file, ASSIGNMENT, Signer(b"s" * 32))
        samples, k = wire.samples.blank(np.array(ASSIGNMENT["left"])), PAUSE + MOST_WINDOW + 5
        samples["k"], samples["time_ns"] = k, wire.times.t(k)  # which no worker has reached
        forger.put("samples/left", wire.pack_samples("left", k, samples))
        forger.count()
        run.go_on.set()
        outcome = run.outcome()
        for worker in workers:
            worker.end()
    assert outcome.status == "failed"
    assert f"tick {k}: worker left sent it twice with other contents" in outcome.reason
    assert "another party that has the run's secret put a message in its name" in outcome.reason
