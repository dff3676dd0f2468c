"""Rounds of calls, from Python and native: one class of tests for both, and the same bits of both.

Python's are the oracle of the native ones, and what is left where nothing can be compiled.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from ctypes import c_void_p
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive, unpacked
from nrs_cosim.plant_fmu.archives.quantities import Part, Quantity, View
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.errors import StepError
from nrs_cosim.plant_fmu.fmi.batch_calls import CalledRounds, EarlyEnd, Rounds
from nrs_cosim.plant_fmu.fmi.instances import Instances
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.native.batch_calls import NativeRounds, load_native
from nrs_cosim.plant_fmu.isolation.progress import SIZE, Announced, Progress
from nrs_cosim.plant_fmu.isolation.worker import AnnouncedLibrary
from tests.plant_fmu.faulty_fmu import FAULTS
from tests.plant_fmu.test_drives import DRIVES, bodies, each_version, play, wandering

Array = NDArray[np.float64]
Make = Callable[[Library, Instances], Rounds]
H, ERROR = 0.1, 3


def called(library: Library, instances: Instances) -> Rounds:
    return CalledRounds(library, instances.handles)


def native(library: Library, instances: Instances) -> Rounds:
    functions = load_native()
    assert functions
    names = [f"robot {robot}" for robot in instances.robots]
    return NativeRounds(functions, library, instances.handles, names)


@pytest.fixture
def opened() -> Iterator[Callable[..., tuple[Library, Instances]]]:
    """Return a function that opens three arms, at rest and beyond their initialisation."""
    with ExitStack() as stack:

        def arms(fmi: int, load: Any = Library) -> tuple[Library, Instances]:
            archive = open_archive(build("two_link_arm", fmi))
            folder = stack.enter_context(unpacked(archive))
            library = stack.enter_context(load(archive, folder, "CoSimulation"))
            of = bodies(3)
            instances = Instances(library, of, {})
            instances.initialise(of, [{"q": body.q, "qd": body.qd} for body in of])
            return library, instances

        yield arms


@each_version
@pytest.mark.parametrize("make", [called, native])
class TestEveryRounds:
    """What rounds promise, however they are gone through."""

    def test_set_values_are_read_back(self, opened: Any, make: Make, fmi: int) -> None:
        library, instances = opened(fmi)
        rounds, rows = make(library, instances), np.arange(6.0).reshape(3, 2)
        view = View([instances.vector("tau", 2)], rows)
        write, read = (rounds.exchange(view, setting=setting) for setting in (True, False))
        assert write() is None
        rows[:] = 0.0
        assert read() is None
        np.testing.assert_array_equal(rows, np.arange(6.0).reshape(3, 2))

    def test_a_step_is_followed_by_its_outputs(self, opened: Any, make: Make, fmi: int) -> None:
        library, instances = opened(fmi)
        time = Quantity("time", (Part(0, 1, 0, 1, 1.0, ()),))
        rows = np.zeros((3, 1))
        advance = make(library, instances).advance(View([time], rows))
        for k in range(3):
            assert advance(k * H, H) is None
            np.testing.assert_array_equal(rows, np.full((3, 1), k * H + H))

    def test_states_are_saved_and_restored(self, opened: Any, make: Make, fmi: int) -> None:
        library, instances = opened(fmi)
        rounds, rows, states = make(library, instances), np.zeros((3, 2)), (c_void_p * 3)()
        advance = rounds.advance(View([instances.vector("q", 2)], rows))
        keep, go_back = (rounds.recall(states, keeping=keeping) for keeping in (True, False))
        assert keep() is None
        assert advance(0.0, H) is None
        there = rows.copy()
        assert go_back() is None
        assert advance(0.0, H) is None
        np.testing.assert_array_equal(rows, there)

    def test_the_first_failure_ends_the_batch(self, opened: Any, make: Make, fmi: int) -> None:
        library, instances = opened(fmi)
        rounds, time = make(library, instances), np.zeros((3, 1))
        now = View([Quantity("time", (Part(0, 1, 0, 1, 1.0, ()),))], time)
        assert instances.rounds.exchange(now, setting=False)() is None
        library.calls.reset(instances.handles[1])
        assert rounds.advance(now)(0.0, H) == EarlyEnd(1, ERROR, stepping=True)
        assert rounds.exchange(now, setting=False)() is None
        np.testing.assert_array_equal(time, [[H], [0.0], [0.0]])

    def test_an_unknown_variable_ends_the_batch(self, opened: Any, make: Make, fmi: int) -> None:
        library, instances = opened(fmi)
        rounds = make(library, instances)
        view = View([Quantity("none", (Part(99999, 1, 0, 1, 1.0, ()),))], np.zeros((3, 1)))
        assert rounds.exchange(view, setting=True)() == EarlyEnd(0, ERROR)
        assert rounds.exchange(view, setting=False)() == EarlyEnd(0, ERROR)
        assert rounds.advance(view)(0.0, H) == EarlyEnd(0, ERROR, stepping=False)

    def test_each_call_is_announced_to_progress(self, opened: Any, make: Make, fmi: int) -> None:
        progress = Progress(memoryview(bytearray(SIZE)))

        def load(archive: Archive, folder: Path, kind: Any) -> Library:
            return AnnouncedLibrary(progress, archive, folder, kind)

        library, instances = opened(fmi, load)
        rounds, rows, states = make(library, instances), np.zeros((3, 2)), (c_void_p * 3)()
        view = View([instances.vector("tau", 2)], rows)
        (before,) = progress.last
        for go, calls, act in (
            (rounds.exchange(view, setting=True), 3, "set"),
            (rounds.recall(states, keeping=True), 3, "get"),
            (lambda: rounds.advance(view)(0.0, H), 6, "get"),
            (rounds.recall(states, keeping=False), 3, "set"),
        ):
            progress.rest()
            assert go() is None
            (last,) = progress.last
            assert last == Announced(before.calls + calls, "robot 3", act, False)
            before = last
        library.calls.reset(instances.handles[0])
        (before,) = progress.last
        assert rounds.advance(view)(0.0, H) == EarlyEnd(0, ERROR, stepping=True)
        assert progress.last == [Announced(before.calls + 1, "robot 1", "step", False)]


@contextmanager
def from_python() -> Iterator[None]:
    """Let nothing be called natively."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nrs_cosim.plant_fmu.fmi.instances.native_rounds", lambda *_: None)
        yield


@each_version
@pytest.mark.parametrize("name", DRIVES)
def test_batch_calls_from_c_and_python_give_the_same_bits(name: str, fmi: int) -> None:
    held, archive = wandering(slice(6)), open_archive(build("two_link_arm", fmi))
    with ExitStack() as stack:
        plants = open_plants(stack, archive, bodies(), {}, DRIVES[name])
        with from_python():
            oracle = open_plants(stack, archive, bodies(), {}, DRIVES[name])
        for first in (0, 3):
            ours, theirs = (play(each, held, first, first + 3) for each in (plants, oracle))
            assert ours.tobytes() == theirs.tobytes()
            assert plants.save() == oracle.save()


@each_version
def test_any_number_of_threads_gives_the_same_bits(fmi: int) -> None:
    archive, many = open_archive(build("two_link_arm", fmi)), 45
    rows, played = np.arange(many) % 6, []
    held = [(position[rows], velocity[rows]) for position, velocity in wandering(slice(6))]
    for threads in (1, 2, 3):
        with ExitStack() as stack:
            plants = open_plants(stack, archive, bodies(many), {}, Driving())
            assert isinstance(plants, Stepped)
            plants.instances.rounds.use_threads(threads)
            played.append([play(plants, held, 0, 3).tobytes(), plants.save()])
    assert played[0] == played[1] == played[2]


@pytest.mark.parametrize("fault", ["error", "end"])
def test_the_first_robot_that_fails_is_named_whatever_the_number_of_threads(
    faulty: Path, fault: str
) -> None:
    result = {failure(open_archive(faulty), fault, many=40, threads=threads) for threads in (1, 4)}
    (said,) = result
    assert "robot 2 " in said


def test_calls_are_made_by_as_many_threads_as_can_announce_them(opened: Any) -> None:
    library, instances = opened(3)
    progress = Progress(memoryview(bytearray(2 * SIZE)))
    for library.progress, threads in (((), 4), (progress.addresses, 2)):
        rounds = native(library, instances)
        assert isinstance(rounds, NativeRounds)
        rounds.use_threads(4)
        assert rounds.threads == threads


def failure(archive: Archive, fault: str, many: int = 3, threads: int = 1) -> str:
    """Return the error of robots of which the second fails, and those after it too."""
    fails = {"fault": FAULTS.index(fault), "fault_time": 0.15}
    of = [replace(b, parameters=fails if b.robot > 1 else {}) for b in bodies(many)]
    with ExitStack() as stack:
        plants = open_plants(stack, archive, of, {}, Driving())
        assert isinstance(plants, Stepped)
        plants.instances.rounds.use_threads(threads)
        plants.advance(0.0, H)
        with pytest.raises(StepError) as error:
            plants.advance(H, H)
    return str(error.value)


@pytest.mark.parametrize("fault", ["discard", "error", "fatal", "nan", "end", "early", "no status"])
def test_batch_calls_from_c_and_python_fail_alike(faulty: Path, fault: str) -> None:
    archive = open_archive(faulty)
    result = failure(archive, fault)
    assert "robot 2 " in result
    with from_python():
        assert failure(archive, fault) == result


@each_version
def test_batch_calls_from_c_and_python_pass_on_the_fmus_messages(fmi: int) -> None:
    archive, result = open_archive(build("two_link_arm", fmi)), []
    wild = np.array([[0.0, 0.0], [0.0, np.nan], [np.nan, 0.0]])

    def refused() -> str:
        with ExitStack() as stack:
            plants = open_plants(stack, archive, bodies(3), {}, Driving())
            with pytest.raises(StepError) as error:
                plants.hold(wild, wild)
        return str(error.value)

    result.append(refused())
    with from_python():
        result.append(refused())
    assert result[0] == result[1]
    assert "robot 2 " in result[0]
    assert result[0].endswith("ended with Error: setting position_ref to nan") or fmi == 2


@pytest.fixture
def without_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("CC", "none-such")
    monkeypatch.setenv("NRS_CACHE", str(tmp_path))
    load_native.cache_clear()
    yield
    load_native.cache_clear()


@pytest.mark.usefixtures("without_compiler")
def test_without_a_compiler_the_calls_are_made_from_python(
    faulty: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    made = []
    monkeypatch.setattr(Stepped, "step", lambda self, *_: made.append(self.instances.rounds))
    with ExitStack() as stack:
        plants = open_plants(stack, open_archive(faulty), bodies(3), {}, Driving())
        plants.advance(0.0, H)
    assert [type(rounds) for rounds in made] == [CalledRounds]
    (said,) = caplog.messages
    assert said.startswith(
        "robots are stepped by calls from Python, which is slower: no C compiler"
    )


def test_unloadable_batch_code_is_reported_once_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refused(_path: str) -> None:
        raise OSError("failed to map segment from shared object")

    monkeypatch.setattr("nrs_cosim.plant_fmu.fmi.native.batch_calls.CDLL", refused)
    load_native.cache_clear()
    assert load_native() is load_native() is None
    load_native.cache_clear()
    (said,) = caplog.messages
    assert "failed to map segment from shared object; if the disk of " in said
    assert said.endswith(" is mounted noexec, set NRS_CACHE to another folder")
