"""A stranger on the session where the workers of a run meet."""

from contextlib import contextmanager
from threading import Event

import pytest
import zenoh

from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.cluster.remote_workers import Run, alone, paper_file
from tests.guard import GUARD

ASSIGNMENT = {"left": (1, 2, 3), "right": (4, 5, 6)}


def fixture_of_a_run_alone(ticks):
    """Return a module's fixture: a scenario of so many ticks, and its digest in one process."""

    @pytest.fixture(scope="module")
    def run_alone(tmp_path_factory):
        folder = tmp_path_factory.mktemp("alone")
        file = read_scenario(paper_file(folder, ticks))
        return file, alone(file, folder)

    return run_alone


class Intruder:
    """A Zenoh client of a stranger, beside another that tells when what it puts was passed on."""

    def __init__(self, meet, run, **options):
        endpoints = Endpoints(connect=(meet,), insecure_tcp=True, **options)
        self.run, self.prefix = run, f"nrs/{run}/"
        self.session, self._witness = open_session(endpoints), open_session(endpoints)
        self._put, self.intercepted, self._came = 0, {}, Event()
        self._witness.declare_subscriber("nrs/**", self._receive)
        next(self._witness.get("nrs/none", timeout=GUARD), None)  # by then it is declared

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.session.close()
        self._witness.close()

    def _receive(self, sample):
        key = str(sample.key_expr)
        if key == "nrs/last":
            self._came.set()
        self.intercepted[key.removeprefix(self.prefix)] = sample.payload.to_bytes()

    def put(self, key, payload):
        """Put a message on a key of the run's, or from the root for one that begins with /."""
        whole = f"nrs{key}" if key.startswith("/") else self.prefix + key
        self.session.put(whole, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        self._put += 1

    def count(self):
        """Return how many messages were put, when the last has come to where the workers meet."""
        self.put("/last", b"")
        assert self._came.wait(GUARD)
        next(self.session.get("nrs/none", timeout=GUARD), None)  # by then it is judged there
        return self._put

    def ask(self, key, payload, wait=GUARD):
        """Ask, and return all answers; those that are not answered wait in vain."""
        replies = self.session.get(self.prefix + key, payload=payload, timeout=wait)
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok]


@contextmanager
def intruded(file, folder, meet, **options):
    """Yield a run that waits for workers on plain TCP, and a stranger who is there before them."""
    with (
        Run(file, folder / "run.mcap", listen=(meet,), **options) as run,
        Intruder(meet, run.until("waits for workers").split()[1]) as intruder,
    ):
        yield run, intruder
