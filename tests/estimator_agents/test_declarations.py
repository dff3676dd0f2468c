"""What is wrong with a class of another package is one line, which says what and where."""

import sys

import numpy as np
import pytest

from nrs_cosim.estimator_agents.algorithm import Algorithm, conditions, modes
from nrs_cosim.estimator_agents.declarations import wrong_declarations
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.scenarios import write

MODULE = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim import Algorithm, Field, Values


@dataclass(frozen=True)
class Faulty(Algorithm):
    alpha: float = 0.9
    beta: float = 0.9
    STATE: ClassVar = {**Algorithm.STATE, "memory": Field(("m",)), "count": Field(())}

    def receive(self, now, x, received):
        return x
"""


@pytest.fixture
def faulty(tmp_path, monkeypatch):
    """Return a call of the command on that class, with some of its lines replaced."""
    about = tmp_path / "faulty-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[nrs.algorithms]\nfaulty = faulty:Faulty\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    write(tmp_path / "s.toml", {"algorithm.name": "faulty", "run.duration": 0.5})

    def command(name, was, now):
        assert MODULE.count(was) == 1
        code = MODULE.replace(was, now)
        (tmp_path / "faulty.py").write_text(code, "utf-8")
        sys.modules.pop("faulty", None)
        output = ["-o", "s.mcap"] if name == "run" else []
        done = nrs(name, "s.toml", *output, cwd=tmp_path)
        lines = {line.strip(): i for i, line in enumerate(code.splitlines(), 1)}
        return done, lambda line: f"at {tmp_path / 'faulty.py'}:{lines[line]}"

    yield command
    sys.modules.pop("faulty", None)


STATE = '    STATE: ClassVar = {**Algorithm.STATE, "memory": Field(("m",)), "count": Field(())}\n'
RECEIVE = "    def receive(self, now, x, received):\n        return x\n"
CLASS = "@dataclass(frozen=True)"
DECLARED = [
    (
        "class Faulty(Algorithm):",
        "class Faulty:",
        "from 'faulty:Faulty' is no subclass of nrs_cosim.",
    ),
    (
        STATE,
        STATE + '    SENT: ClassVar = {"meory": Field()}\n',
        "SENT: meory: is no field of STATE",
    ),
    (STATE, STATE + "    SENT: ClassVar = {}\n", "SENT: expected one field at least"),
    (
        STATE,
        STATE + "    LINK: ClassVar = 3\n",
        "LINK: expected a mapping of names to fields, got 3",
    ),
    (
        STATE,
        '    STATE: ClassVar = {"position": Field()}\n',
        "STATE: velocity: expected a field of",
    ),
    (
        STATE,
        '    STATE: ClassVar = {**Algorithm.STATE, "items": Field()}\n',
        "STATE: items: is a method of all values; give another name",
    ),
    (
        STATE,
        '    STATE: ClassVar = {**Algorithm.STATE, "a": Field(("k",))}\n',
        "STATE: a: shape: expected a tuple of whole numbers > 0 and of m, n, in_degree",
    ),
    (
        STATE,
        STATE + '    SENT: ClassVar = {"count": Field((), truth="position")}\n',
        "SENT: count: expected the shape ('m',) of the target's position",
    ),
    (
        STATE,
        STATE + '    MISSING: ClassVar = ("guess",)\n',
        "MISSING: expected a tuple of some of hold",
    ),
    (STATE, STATE + '    ARRIVALS: ClassVar = "last"\n', "ARRIVALS: expected one of newest, every"),
    (
        STATE,
        STATE + '    ARRIVALS: ClassVar = "every"\n',
        'MISSING: expected ("drop",): with ARRIVALS',
    ),
    (STATE, STATE + "    TRIGGERED: ClassVar = True\n", "TRIGGERED: expected a method send, which"),
    (STATE, STATE + "    TRIGGERED: ClassVar = 1\n", "TRIGGERED: expected True or False, got 1"),
    (RECEIVE, "    pass\n", "jump: expected a method jump or receive"),
    (
        STATE,
        STATE + '    LINK: ClassVar = {"had": Field()}\n    SEPARATE_GRAPHS: ClassVar = True\n',
        "SEPARATE_GRAPHS: expected False, for LINK and ARRIVALS are of one digraph",
    ),
]


@pytest.mark.parametrize(("was", "now", "why"), DECLARED, ids=[case[2][:24] for case in DECLARED])
def test_what_it_declares_wrongly_is_one_line_before_anything_runs(faulty, was, now, why):
    done, at = faulty("check", was, now)
    line = done.stderr.replace("\n", "")
    assert line.startswith("error: algorithm.name: faulty")
    assert why in line
    assert line.endswith(at(CLASS))
    assert done.returncode == 2
    assert "Traceback" not in done.stderr


SEND = "    def send(self, now, x):\n        return {}\n\n" + RECEIVE
MEASURE = "    def measure(self, now, target):\n        return {}\n\n" + RECEIVE
FAILING = [
    (
        RECEIVE,
        MEASURE.format("target.replace(position=np.zeros(3))"),
        "measure(now, target): ValueError: expected a position of shape (6, 2), or (2,) for all "
        "alike, got (3,)",
        "def measure(self, now, target):",
    ),
    (
        RECEIVE,
        MEASURE.format("target.position"),
        "measure(now, target): TypeError: expected the measurement as Values, got ndarray",
        "def measure(self, now, target):",
    ),
    (
        "        return x\n",
        "        return x.replace(memry=x.memory)\n",
        "receive(now, x, received): TypeError: no field memry; the fields here are position, "
        "velocity, memory, count",
        "return x.replace(memry=x.memory)",
    ),
    (
        "        return x\n",
        "        return x.replace(memory=x.memory[0])\n",
        "receive(now, x, received): ValueError: expected a memory of shape (6, 2), as it was "
        "given, got (2,)",
        "def receive(self, now, x, received):",
    ),
    (
        "        return x\n",
        "        return x.replace(count=x.count > 0)\n",
        "receive(now, x, received): TypeError: expected a count of doubles in the state, got bool",
        "def receive(self, now, x, received):",
    ),
    (
        "        return x\n",
        "        return None\n",
        "receive(now, x, received): TypeError: expected the state as Values, got NoneType",
        "def receive(self, now, x, received):",
    ),
    (
        RECEIVE,
        SEND.format("x, Values(position=x.position), None"),
        "send(now, x): TypeError: expected the message to have a velocity; it has position",
        "def send(self, now, x):",
    ),
    (
        RECEIVE,
        SEND.format("x"),
        "send(now, x): TypeError: expected the state, the messages, and who sends (None for all)",
        "def send(self, now, x):",
    ),
    (
        RECEIVE,
        SEND.format("x, x.at(slice(None)), None"),
        "send(now, x): TypeError: expected no memory in the message; it has position, velocity",
        "def send(self, now, x):",
    ),
    (
        "        return x\n",
        "        received.samples.position[:] = 0\n        return x\n",
        "receive(now, x, received): ValueError: assignment destination is read-only",
        "received.samples.position[:] = 0",
    ),
]


@pytest.mark.parametrize(("was", "now", "why", "line"), FAILING, ids=[c[2][:60] for c in FAILING])
@pytest.mark.parametrize("command", cases(["check", "run"], ["check"]))
def test_what_it_returns_wrongly_is_one_line_before_anything_runs(
    faulty, tmp_path, command, was, now, why, line
):
    done, at = faulty(command, was, now)
    expected = f"error: algorithm.name: faulty.{why}, {at(line)}"
    assert (done.stderr.replace("\n", ""), done.returncode) == (expected, 2)
    assert not list(tmp_path.glob("s.mcap*"))


LATER = "now.k > 4 and x.nothing"


def test_what_it_raises_later_is_told_by_theory_and_recorded_with_its_place(faulty, tmp_path):
    """Theory tries it at other times than a run begins with."""
    simple = STATE.replace('Field(("m",)), "count": Field(())', "Field()") + "\n" + RECEIVE
    later = simple.replace("return x", f"{LATER}\n        return x")
    done, at = faulty("run", f"{STATE}\n{RECEIVE}", later)
    expected = (
        "algorithm.name: faulty.receive(now, x, received): AttributeError: no field nothing; the "
        f"fields here are position, velocity, memory, {at(LATER)}"
    )
    with Reader(tmp_path / "s.mcap") as reader:
        assert (reader.status, reader.reason, reader.ticks) == ("failed", expected, 4)
    assert (done.stderr.replace("\n", ""), done.returncode) == (f"failed: {expected}", 1)
    why = f"the algorithm is not known to be linear (tried with other numbers: {expected})"
    assert why in " ".join(nrs("info", "s.mcap", cwd=tmp_path).stdout.split())


def test_one_that_mixes_robots_is_refused_before_anything_runs(faulty, tmp_path):
    mixed = "return x.replace(position=x.position - x.position.mean(axis=0))"
    for command in ("check", "run"):
        done, at = faulty(command, "return x", mixed)
        place = at("def receive(self, now, x, received):")
        assert done.stderr.replace("\n", "") == (
            "error: algorithm faulty: receive returned another position for robot 1 with half of "
            "the robots on a worker than with all at tick 1; take a row from that robot's own row "
            f"and in-edges alone, as received.mean does, {place}"
        )
        assert done.returncode == 2
    assert not list(tmp_path.glob("s.mcap*"))


MESSAGES = [
    (
        "error",
        "x, Values(position=x.position, velocity=x.velocity[:, :1]), None",
        "send returned a velocity of shape (6, 1), expected (6, 2)",
    ),
    (
        "failed",
        "x, Values(position=x.position + np.inf, velocity=x.velocity), None",
        "send returned a position of inf for robot 1 at tick 1",
    ),
    (
        "error",
        "x, Values(position=x.position, velocity=x.velocity), np.ones(6, bool)",
        "send returned who sends; an algorithm that does so declares TRIGGERED = True",
    ),
]


@pytest.mark.parametrize(("ending", "sent", "why"), MESSAGES)
def test_a_message_that_cannot_travel_ends_the_run(faulty, ending, sent, why):
    done, at = faulty("run", RECEIVE, SEND.format(sent))
    assert done.stderr.replace("\n", "") == (
        f"{ending}: algorithm faulty: {why}, {at('def send(self, now, x):')}"
    )
    assert done.returncode == {"failed": 1, "error": 2}[ending]


def test_a_class_that_declares_nothing_wrong_is_let_pass(faulty):
    done, _ = faulty("run", "alpha: float = 0.9", "alpha: float = 0.8")
    assert (done.returncode, done.stderr) == (0, "")
    import faulty as module  # noqa: PLC0415

    assert wrong_declarations(module.Faulty) == []


@pytest.mark.parametrize("measured", ["target.position.sum()", "target.position.sum() + 0 * x"])
def test_a_number_without_axes_is_measured_and_sent_as_any_field(faulty, tmp_path, measured):
    sent = '    SENT: ClassVar = {**Algorithm.SENT, "count": Field(())}\n\n'
    lines = f"x = now.robots\n        return target.replace(count={measured})"
    measure = MEASURE.replace("return {}", lines)
    done, _ = faulty("run", RECEIVE, sent + measure)
    assert (done.returncode, done.stderr) == (0, "")
    with Recording(tmp_path / "s.mcap") as recording:
        found = recording.measurements()
    assert len(found) == 5
    assert found["count"].tolist() == found["position"].sum(axis=1).tolist()


def test_what_declares_no_modes_has_none_on_two_digraphs_either():
    spectra = (np.array([0.5]), np.array([0.4]))
    assert len(modes(Algorithm(), spectra, 0.1)) == len(conditions(Algorithm(), spectra, 0.1)) == 0
