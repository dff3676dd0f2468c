"""An FMU may call what it was given as long as it lives: its words are its own, and it ends well.

The FMU of these tests does so to its last moment. What could end the process runs in one of its
own, so that a crash is a failure of one test.
"""

import json
import shutil
import subprocess
import sys

import pytest

from tests.cases import cases
from tests.guard import GUARD
from tests.plant_fmu.talker import build_talker
from tests.scenarios import tables, write

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

NRS = [sys.executable, "-c", "from nrs_cosim.orchestrator.__main__ import main; main()"]


def two_robots(*, isolate, refuses=0.0):
    """Return the tables of two robots that receive from each other; the first may refuse a step."""
    plant = {"fmu": "talker.fmu", "isolate": isolate}
    up, around = {"uniform": [0.0, 0.5]}, {"uniform": [-0.5, 0.5]}
    return tables(
        {
            "run": {"duration": 1.0, "sampling_period": 0.1, "seed": 1},
            "controller": {"kp": 20.0, "kd": 10.0},
            "network": {"adjacency": [[0, 1], [1, 0]], "pinning": [1, 0]},
            "target.axes": [{"offset": 0.2, "sines": [{"amplitude": 0.3, "frequency": 1.0}]}],
            "plant": plant,
            "disturbance": None,
            "initial": {"position": up, "velocity": around, "q": up, "qd": around},
            "robots": [{"id": 1, "plant": {**plant, "parameters": {"refuses": refuses}}}],
        }
    )


BEGIN = """
import json, sys
from ctypes import byref, c_double, c_uint
from contextlib import ExitStack
from pathlib import Path
from nrs_cosim.plant_fmu.archives.archive import open_archive, unpacked
from nrs_cosim.plant_fmu.fmi.calls import bind_step
from nrs_cosim.plant_fmu.fmi.library import Library

stack, libraries = ExitStack(), []

def load(path, *names):
    archive = open_archive(Path(path))
    folder = stack.enter_context(unpacked(archive))
    library = stack.enter_context(Library(archive, folder, "CoSimulation"))
    libraries.append((library, names))
    return library, [library.instantiate(name) for name in names]

def refuse(library, handle):
    library.calls.set(handle, (c_uint * 1)(3), 1, byref(c_double(0.1)), 1)
    assert library.bind(bind_step).step(handle, 0.0, 1.0) == 3

def words():
    return [{name: library.last_words(name) for name in names} for library, names in libraries]
"""
TELL = "\nprint(json.dumps(words()))\n"


def printed_by(script, *paths):
    """Run a script in a process of its own, and return what it printed."""
    command = [sys.executable, "-c", BEGIN + script + TELL, *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=GUARD, check=False)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr}"
    return json.loads(done.stdout)


def said(fmi, what):
    return f": {what} as no. 7, 0.25" if fmi == 2 else f": {what}"


@pytest.fixture(scope="module")
def talker(tmp_path_factory):
    """Return a function that gives the FMU of a version."""
    folder = tmp_path_factory.mktemp("talker")
    paths = {fmi: build_talker(folder / f"talker{fmi}.fmu", fmi) for fmi in (2, 3)}
    return paths.__getitem__


@pytest.mark.parametrize("fmi", [2, 3])
def test_all_instances_of_two_libraries_are_freed(talker, fmi):
    script = """
load(sys.argv[1], "robot 1", "robot 2")
load(sys.argv[1], "robot 1", "robot 3")
stack.close()
"""
    freed = said(fmi, "freed")
    assert printed_by(script, talker(fmi)) == [
        {"robot 1": freed, "robot 2": freed},
        {"robot 1": freed, "robot 3": freed},
    ]


@pytest.mark.parametrize("fmi", [2, 3])
def test_threads_of_a_process_have_libraries_of_their_own(talker, fmi):
    script = """
from concurrent.futures import ThreadPoolExecutor

def lived(robot):
    received = []
    for _ in range(10):
        archive = open_archive(Path(sys.argv[1]))
        with unpacked(archive) as folder, Library(archive, folder, "CoSimulation") as library:
            handle = library.instantiate(robot)
            library.instantiate("robot 0")
            refuse(library, handle)
            received += [library.last_words(robot), library.last_words("robot 0")]
        received += [library.last_words(robot), library.last_words("robot 0")]
    return sorted(set(received))

with ThreadPoolExecutor(4) as threads:
    lives = list(threads.map(lived, ["robot 1", "robot 2", "robot 3", "robot 4"]))
words = lambda: lives
"""
    said_of_each = sorted(said(fmi, what) for what in ("born", "refused", "freed"))
    assert printed_by(script, talker(fmi)) == [said_of_each] * 4


@pytest.mark.parametrize("first", [2, 3])
def test_a_library_goes_on_after_another_has_been_unloaded(talker, first):
    script = """
library, handles = load(sys.argv[1], "robot 1", "robot 2")
with stack.pop_all():
    with ExitStack() as stack:
        load(sys.argv[2], "robot 1")
    refuse(library, handles[0])
    received = words()
words = lambda: received
"""
    second = 5 - first
    assert printed_by(script, talker(first), talker(second)) == [
        {"robot 1": said(first, "refused"), "robot 2": said(first, "born")},
        {"robot 1": said(second, "freed")},
    ]


@pytest.mark.parametrize("fmi", [2, 3])
def test_log_messages_are_kept_by_robot(talker, fmi):
    script = """
library, handles = load(sys.argv[1], "robot 1", "robot 2")
refuse(library, handles[0])
"""
    assert printed_by(script, talker(fmi)) == [
        {"robot 1": said(fmi, "refused"), "robot 2": said(fmi, "born")}
    ]


def test_another_user_of_fmpys_logger_takes_no_messages_away(talker):
    script = """
from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.logging import addLoggerProxy

library, handles = load(sys.argv[1], "robot 1", "robot 2")
other = fmi2CallbackFunctions()
other.logger = fmi2CallbackLoggerTYPE(lambda *_: None)
addLoggerProxy(byref(other))
del other
stack.close()
"""
    freed = said(2, "freed")
    assert printed_by(script, talker(2)) == [{"robot 1": freed, "robot 2": freed}]


@pytest.mark.parametrize(
    ("environment", "name", "received"),
    [
        ("NULL", "joint->name", {"robot 1": "refused", "robot 2": "born"}),
        ("joint", "joint->name", {"robot 1": "refused", "robot 2": "born"}),
        ("NULL", "NULL", {"robot 1": "born", "robot 2": ""}),
        ("given->componentEnvironment", "NULL", {"robot 1": "refused", "robot 2": "born"}),
    ],
)
def test_log_messages_without_environment_go_by_instance_name(
    tmp_path, environment, name, received
):
    path = build_talker(tmp_path / "talker.fmu", 2, environment, name)
    script = """
library, handles = load(sys.argv[1], "robot 1", "robot 2")
refuse(library, handles[0])
"""
    expected = {robot: said(2, what) if what else "" for robot, what in received.items()}
    assert printed_by(script, path) == [expected]


@pytest.fixture(scope="module")
def place(talker, tmp_path_factory):
    """Return a folder with the FMU, and a scenario of two robots that have it."""
    folder = tmp_path_factory.mktemp("place")
    shutil.copy(talker(2), folder / "talker.fmu")
    for isolate in (True, False):
        write(folder / f"isolate_{isolate}.toml".lower(), base=two_robots(isolate=isolate))
    return folder


def nrs(place, *arguments):
    """Run the command in a process of its own."""
    command = [*NRS, *arguments]
    return subprocess.run(
        command, cwd=place, capture_output=True, text=True, timeout=GUARD, check=False
    )


LOGGING = [
    ("fmu", "check", "talker.fmu", "--scenario", "isolate_true.toml"),
    ("run", "isolate_false.toml", "-o", "false.mcap"),
    ("fmu", "check", "talker.fmu"),
    ("check", "isolate_true.toml"),
    ("check", "isolate_false.toml"),
    ("run", "isolate_true.toml", "-o", "true.mcap"),
]


@pytest.mark.parametrize("arguments", cases(LOGGING, LOGGING[:2]))
def test_an_fmu_that_logs_until_it_is_freed_crashes_no_command(place, arguments):
    done = nrs(place, *arguments)
    assert done.returncode == 0, f"{done.returncode}: {done.stdout}{done.stderr}"
    assert "crashed" not in done.stdout + done.stderr
    if "check" in arguments and "fmu" not in arguments:
        assert "(sampled, " in done.stdout


@pytest.mark.parametrize("isolate", [True, False])
def test_a_refused_step_is_reported_with_the_robots_own_message(place, isolate):
    write(place / "refused.toml", base=two_robots(isolate=isolate, refuses=0.55))
    done = nrs(place, "run", "refused.toml", "-o", f"refused_{isolate}.mcap")
    assert done.returncode == 1, f"{done.returncode}: {done.stderr}"
    assert "robot 1 (talker.fmu) at t = 0.5" in done.stderr
    assert "ended with Error: refused as no. 7, 0.25" in done.stderr


@pytest.mark.parametrize("isolate", [True, False])
def test_nothing_is_called_after_a_fatal_status(place, isolate):
    write(place / "fatal.toml", base=two_robots(isolate=isolate, refuses=-0.55))
    done = nrs(place, "run", "fatal.toml", "-o", f"fatal_{isolate}.mcap")
    assert done.returncode == 1, f"{done.returncode}: {done.stderr}"
    assert "ended with Fatal: refused as no. 7, 0.25" in done.stderr


@pytest.mark.parametrize("isolate", [True, False])
@pytest.mark.parametrize("command", cases(["check", "run"], ["run"]))
def test_an_fmus_printing_does_not_reach_our_standard_output(tmp_path, isolate, command):
    build_talker(tmp_path / "talker.fmu", prints=True)
    write(tmp_path / "s.toml", base=two_robots(isolate=isolate))
    options = ["--json"] if command == "check" else ["-o", "run.mcap"]
    done = subprocess.run(
        [*NRS, command, "s.toml", *options],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=GUARD,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "printed by an FMU" not in done.stdout
    assert ("printed by an FMU" in done.stderr) is not isolate
    if command == "check":
        assert "spectral_radius" in json.loads(done.stdout)
    else:
        assert "run.mcap" in done.stdout
