"""Who gets onto the bus, who is kept out and told why, and whose messages are received there."""

import queue
import socket
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from threading import Thread

import pytest
import zenoh
from cryptography.hazmat.primitives.serialization import PrivateFormat

from nrs_cosim.bus.errors import BusError, InputError
from nrs_cosim.bus.network.access import access_control
from nrs_cosim.bus.network.endpoints import LOCAL_LEASE, NETWORK_LEASE, Endpoints, zenoh_settings
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.bus.text import quoted
from tests.guard import GUARD, VAIN
from tests.network.authority import LONG_AGO, Authority
from tests.network.ports import free_port

BLOCK = zenoh.CongestionControl.BLOCK


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("authority"))


@pytest.fixture(scope="module")
def tls(authority):
    return {name: authority.issue(name) for name in ("orchestrator", "left", "right", "stranger")}


@contextmanager
def opened(*endpoints):
    with ExitStack() as stack:
        yield [stack.enter_context(open_session(e)) for e in endpoints]


def pair(address, listening=None, connecting=None, **more):
    listen = Endpoints(listen=(address,), tls=listening, insecure_tcp=True, **more)
    return listen, Endpoints(connect=(address,), tls=connecting, wait=GUARD, insecure_tcp=True)


def received(session, pattern):
    """Return a queue of (key, payload) of all that the session receives."""
    inbox = queue.Queue()
    session.declare_subscriber(
        pattern, lambda s: inbox.put((str(s.key_expr), s.payload.to_bytes()))
    )
    return inbox


def answered(session, key):
    replies = session.get(key, timeout=GUARD)
    return [reply.ok.payload.to_bytes() for reply in replies if reply.ok]


def expect_conversation(hub, client):
    """Both directions, in an order that a query decides and no clock."""
    hub.declare_queryable("nrs/r/start/*", lambda q: q.reply(q.key_expr, b"go"))
    at_hub, at_client = (
        received(hub, "nrs/r/samples/left"),
        received(client, "nrs/r/samples/target"),
    )
    assert answered(client, "nrs/r/start/left") == [b"go"]
    client.put("nrs/r/samples/left", b"up", congestion_control=BLOCK)
    assert at_hub.get(timeout=GUARD) == ("nrs/r/samples/left", b"up")
    hub.put("nrs/r/samples/target", b"down", congestion_control=BLOCK)
    assert at_client.get(timeout=GUARD) == ("nrs/r/samples/target", b"down")


class TestReached:
    @pytest.mark.parametrize("place", ["tcp/127.0.0.1", "tcp/localhost", "tcp/[::1]", "unixsock"])
    def test_plain_tcp_that_was_asked_for_and_sockets_need_no_certificate(self, place, tmp_path):
        if place == "tcp/[::1]":
            try:
                socket.create_server(("::1", 0), family=socket.AF_INET6).close()
            except OSError as error:
                pytest.skip(f"no IPv6 here: {error}")
        address = f"{place}:{free_port()}"
        if place == "unixsock":
            address = f"unixsock-stream/{tmp_path}/s"
        with opened(*pair(address)) as (hub, client):
            expect_conversation(hub, client)

    @pytest.mark.parametrize("form", [PrivateFormat.PKCS8, PrivateFormat.TraditionalOpenSSL])
    def test_certificates_of_one_authority_reach_each_other(self, authority, tls, form):
        left = authority.issue("left", form=form)
        address = f"tls/127.0.0.1:{free_port()}"
        with opened(*pair(address, tls["orchestrator"], left)) as (hub, client):
            expect_conversation(hub, client)
            (link,) = hub.info.links()
            assert link.auth_identifier == "left"
            assert link.zid == client.info.zid()

    def test_clients_receive_from_each_other_through_the_hub(self, tmp_path):
        listen, connect = pair(f"unixsock-stream/{tmp_path}/s")
        with opened(listen, connect, connect) as (hub, one, other):
            hub.declare_queryable("nrs/r/start/*", lambda q: q.reply(q.key_expr, b"go"))
            inbox = received(other, "nrs/r/samples/*")
            assert answered(other, "nrs/r/start/other") == [b"go"]
            one.put("nrs/r/samples/one", b"x", congestion_control=BLOCK)
            assert inbox.get(timeout=GUARD) == ("nrs/r/samples/one", b"x")

    def test_a_client_waits_for_its_router(self, tmp_path):
        listen, connect = pair(f"unixsock-stream/{tmp_path}/s")
        with ExitStack() as stack:
            opening = queue.Queue()
            stack.callback(lambda: opening.get(timeout=GUARD).close())
            thread = Thread(target=lambda: opening.put(open_session(connect)))
            thread.start()
            stack.callback(thread.join)
            hub = stack.enter_context(open_session(listen))
            events = hub.info.declare_transport_events_listener(history=True)
            assert events.recv().kind == zenoh.SampleKind.PUT


class TestRefused:
    """The link does not open, and our words say why."""

    def refusal(self, listening, connecting, address=None, error=InputError):
        listen, connect = pair(address or f"tls/127.0.0.1:{free_port()}", listening, connecting)
        with opened(listen), pytest.raises(error) as rejected:
            open_session(replace(connect, wait=VAIN)).close()
        return str(rejected.value)

    def test_a_worker_of_another_authority(self, tls, tmp_path):
        other = Authority(tmp_path).issue("left")
        said = self.refusal(tls["orchestrator"], replace(other, ca=tls["left"].ca))
        assert "does not know the authority" in said
        assert str(other.certificate) in said

    def test_an_orchestrator_of_another_authority(self, tls, tmp_path):
        said = self.refusal(Authority(tmp_path).issue("orchestrator"), tls["left"])
        assert "its certificate is refused here" in said

    def test_a_worker_whose_certificate_has_expired(self, authority, tls):
        said = self.refusal(tls["orchestrator"], authority.issue("old", valid=LONG_AGO))
        assert "has expired" in said

    def test_an_orchestrator_whose_certificate_has_expired(self, authority, tls):
        said = self.refusal(authority.issue("old", valid=LONG_AGO), tls["left"])
        assert "certificate has expired" in said

    def test_an_orchestrator_of_another_name(self, authority, tls):
        said = self.refusal(authority.issue("elsewhere", "lab.example"), tls["left"])
        assert "127.0.0.1" in said

    def test_connecting_where_nobody_listens_is_refused(self, tls):
        address = f"tls/127.0.0.1:{free_port()}"
        connect = Endpoints(connect=(address,), tls=tls["left"], wait=VAIN)
        with pytest.raises(BusError, match="nothing listens there"):
            open_session(connect).close()

    def test_tls_is_not_spoken_there(self, tls):
        port = free_port()
        with (
            opened(Endpoints(listen=(f"tcp/127.0.0.1:{port}",), insecure_tcp=True)),
            pytest.raises(BusError, match="no TLS is spoken with it"),
        ):
            open_session(
                Endpoints(connect=(f"tls/127.0.0.1:{port}",), tls=tls["left"], wait=VAIN)
            ).close()

    def test_a_port_that_is_taken(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            address = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
            with pytest.raises(InputError, match=f"--listen: {address}: .*in use"):
                open_session(Endpoints(listen=(address,), insecure_tcp=True)).close()


class TestAccess:
    """Every worker speaks for itself alone."""

    @pytest.fixture
    def workers(self, tls):
        address = f"tls/127.0.0.1:{free_port()}"
        listen = Endpoints(listen=(address,), tls=tls["orchestrator"], workers=("left", "right"))
        clients = [Endpoints(connect=(address,), tls=tls[n]) for n in ("left", "right", "stranger")]
        with opened(listen, *clients) as sessions:
            sessions[0].declare_queryable("nrs/**", self.answer)
            yield sessions

    @staticmethod
    def answer(query):
        query.reply(str(query.key_expr).replace("*", "r"), b"go")

    def test_a_forged_key_is_not_delivered(self, workers):
        hub, left, right, _ = workers
        at_hub, at_left = received(hub, "nrs/**"), received(left, "nrs/r/samples/*")
        assert answered(left, "nrs/r/start/left") == [b"go"]
        forged = ("samples/left", "samples/target", "records/left", "orders/left", "orders/right")
        own = ("samples/right", "records/right", "report/right")
        for key in (*forged, *own):
            right.put(f"nrs/r/{key}", b"x", congestion_control=BLOCK)
        assert answered(right, "nrs/r/missed/right") == [b"go"]
        assert [at_hub.get(timeout=GUARD)[0] for _ in own] == [f"nrs/r/{key}" for key in own]
        assert at_hub.empty()
        hub.put("nrs/r/samples/target", b"x", congestion_control=BLOCK)
        story = [at_left.get(timeout=GUARD)[0] for _ in range(2)]
        assert sorted(story) == ["nrs/r/samples/right", "nrs/r/samples/target"]
        assert at_left.empty()

    def test_orders_and_samples_reach_only_their_recipients(self, workers):
        hub, left, right, _ = workers
        inboxes = [received(worker, "nrs/r/orders/*") for worker in (left, right)]
        spied = received(left, "nrs/r/records/*")
        samples = received(left, "nrs/r/samples/*")
        for worker, name in ((left, "left"), (right, "right")):
            assert answered(worker, f"nrs/r/start/{name}") == [b"go"]
        right.put("nrs/r/records/right", b"x", congestion_control=BLOCK)
        right.put("nrs/r/samples/right", b"x", congestion_control=BLOCK)
        for name in ("left", "right"):
            hub.put(f"nrs/r/orders/{name}", b"x", congestion_control=BLOCK)
        for name, inbox in zip(("left", "right"), inboxes, strict=True):
            assert inbox.get(timeout=GUARD)[0] == f"nrs/r/orders/{name}"
            assert inbox.empty()
        assert samples.get(timeout=GUARD)[0] == "nrs/r/samples/right"
        assert spied.empty()

    def test_a_worker_asks_in_its_own_name(self, workers):
        _, left, _, _ = workers
        own = ("nrs/*/join/left", "nrs/r/start/left", "nrs/r/missed/left", "nrs/r/fmu/0123")
        assert [answered(left, key) for key in own] == [[b"go"]] * 4
        others = ("nrs/*/join/right", "nrs/r/start/right", "nrs/r/join/*", "nrs/**")
        assert [answered(left, key) for key in others] == [[]] * 4

    def test_a_worker_lives_in_its_own_name_and_sees_the_orchestrator(self, workers):
        hub, left, right, _ = workers
        alive, seen = queue.Queue(), queue.Queue()
        tokens = [hub.liveliness().declare_token("nrs/r/alive/orchestrator")]
        hub.liveliness().declare_subscriber(
            "nrs/r/alive/*/*", lambda s: alive.put((s.kind, str(s.key_expr)))
        )
        left.liveliness().declare_subscriber(
            "nrs/r/alive/orchestrator", lambda s: seen.put(str(s.key_expr)), history=True
        )
        assert seen.get(timeout=GUARD) == "nrs/r/alive/orchestrator"
        tokens += [
            right.liveliness().declare_token(f"nrs/r/alive/{n}/1") for n in ("left", "right")
        ]
        assert alive.get(timeout=GUARD) == (zenoh.SampleKind.PUT, "nrs/r/alive/right/1")
        for token in tokens[1:]:
            token.undeclare()
        assert alive.get(timeout=GUARD) == (zenoh.SampleKind.DELETE, "nrs/r/alive/right/1")
        assert alive.empty()

    def test_messages_of_a_certificate_without_a_worker_reach_nobody(self, workers):
        hub, left, _, stranger = workers
        at_hub = received(hub, "nrs/**")
        stranger.put("nrs/r/samples/stranger", b"x", congestion_control=BLOCK)
        assert answered(stranger, "nrs/*/join/stranger") == []
        left.put("nrs/r/samples/left", b"x", congestion_control=BLOCK)
        assert at_hub.get(timeout=GUARD)[0] == "nrs/r/samples/left"

    def test_local_workers_beside_remote_ones_are_trusted(self, tls, tmp_path):
        local, remote = f"unixsock-stream/{tmp_path}/s", f"tls/127.0.0.1:{free_port()}"
        both = Endpoints(listen=(local, remote), tls=tls["orchestrator"], workers=("left",))
        with opened(both, Endpoints(connect=(local,))) as (hub, client):
            expect_conversation(hub, client)

    @pytest.mark.parametrize("name", ["", "a/b", "*", "a b*", "target", "orchestrator", " left"])
    def test_a_name_that_no_worker_may_have_is_refused(self, name):
        with pytest.raises(InputError, match=r"bus\.tls\.workers: expected the name of a worker"):
            access_control([name])


class TestInput:
    @pytest.mark.parametrize(
        "endpoint",
        [
            *("", "tls", "127.0.0.1:7447", "tls/", "tls/host", "tls/:7447", "tls/::1:7447"),
            *("udp/127.0.0.1:7447", "quic/127.0.0.1:7447", "ws/127.0.0.1:80", "TCP/127.0.0.1:7"),
            *("tcp/127.0.0.1:0", "tcp/127.0.0.1:65536", "tcp/127.0.0.1:-1", "tcp/127.0.0.1:x"),
            *("tls/host:7447#enable_mtls=false", "tcp/127.0.0.1:7447?rel=0", "tls/a b:1"),
            *("unixsock-stream/relative", "unixsock-stream//no/such/folder/s"),
            "unixsock-stream/" + "/x" * 60,
        ],
    )
    @pytest.mark.parametrize("option", ["listen", "connect"])
    def test_a_malformed_endpoint(self, endpoint, option):
        with pytest.raises(InputError, match=f"--{option}: ") as rejected:
            Endpoints(**{option: (endpoint,)})
        assert quoted(endpoint) in str(rejected.value)

    @pytest.mark.parametrize(
        "host",
        [
            *("0.0.0.0", "[::]", "192.0.2.1", "lab.example", "127.1"),
            *("127.0.0.1", "localhost", "[::1]"),
        ],
    )
    def test_plain_tcp_needs_its_option_on_loopback_too(self, host):
        endpoint = f"tcp/{host}:7447"
        for option in ("listen", "connect"):
            with pytest.raises(InputError, match=rf"--{option}: .*--insecure-tcp"):
                Endpoints(**{option: (endpoint,)})
            Endpoints(**{option: (endpoint,)}, insecure_tcp=True)

    def test_tls_without_certificates_is_refused(self):
        with pytest.raises(InputError, match=r"--connect: .* needs certificates; give --tls-ca"):
            Endpoints(connect=("tls/host:7447",), insecure_tcp=True)

    def test_listening_and_connecting_exclude_each_other(self):
        with pytest.raises(InputError, match="exclude each other"):
            Endpoints(listen=("tcp/127.0.0.1:1",), connect=("tcp/127.0.0.1:1",))

    @pytest.mark.parametrize("name", ["ca", "certificate", "key"])
    def test_an_unusable_certificate_file_is_named(self, tls, tmp_path, name):
        def fault(path):
            with pytest.raises(InputError, match=f"--tls-{name} ") as rejected:
                Endpoints(connect=("tls/h:1",), tls=replace(tls["left"], **{name: path}))
            assert str(path) in str(rejected.value)
            return str(rejected.value)

        assert "no such file" in fault(tmp_path / "none.pem")
        assert "cannot be read" in fault(tmp_path)
        empty = tmp_path / "empty.pem"
        empty.write_text("")
        assert "expected a PEM file" in fault(empty)
        torn = tmp_path / "torn.pem"
        torn.write_bytes(getattr(tls["left"], name).read_bytes()[:200])
        fault(torn)

    def test_a_key_that_does_not_match_its_certificate_is_refused(self, tls):
        with pytest.raises(InputError, match="is not the key of the certificate"):
            Endpoints(connect=("tls/h:1",), tls=replace(tls["left"], key=tls["right"].key))

    @pytest.mark.parametrize("value", [0, -1, float("nan"), float("inf")])
    def test_durations(self, value):
        for name in ("wait", "lease"):
            with pytest.raises(InputError, match=f"{name}: expected"):
                Endpoints(**{name: value})


class TestSettings:
    def test_without_endpoints_no_socket_opens_and_nothing_scouts(self, tls):
        for endpoints in (Endpoints(), *pair("tls/127.0.0.1:1", tls["left"], tls["right"])):
            settings = zenoh_settings(endpoints)
            assert not settings["scouting/multicast/enabled"]
            assert not settings["scouting/gossip/enabled"]
            assert not settings["transport/shared_memory/enabled"]
        settings = zenoh_settings(Endpoints())
        assert settings["listen/endpoints"] == settings["connect/endpoints"] == []

    def test_only_the_protocols_in_use_are_enabled(self, tls):
        listen, _ = pair("tls/127.0.0.1:1", tls["left"], tls["right"])
        assert zenoh_settings(listen)["transport/link/protocols"] == ["tls"]

    def test_silence_closes_a_network_link_but_not_a_local_one(self, tmp_path):
        local, network = f"unixsock-stream/{tmp_path}/s", "tcp/127.0.0.1:1"
        assert Endpoints(listen=(local,)).seconds_of_silence == LOCAL_LEASE
        assert Endpoints(listen=(network,), insecure_tcp=True).seconds_of_silence == NETWORK_LEASE
        assert (
            Endpoints(listen=(local, network), insecure_tcp=True).seconds_of_silence
            == NETWORK_LEASE
        )
        assert Endpoints(listen=(local,), lease=2).seconds_of_silence == 2
