"""After a call of an FMU that was refused, no other is made; not even a fatal one would stop it."""

from contextlib import ExitStack
from dataclasses import replace

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import StepError
from nrs_cosim.plant_fmu.fmi.calls import bind_states
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.model_calls import bind_model
from nrs_cosim.plant_fmu.plants import Body, Disturbance

ERROR, FATAL, NO_STATUS = 3, 4, -1
SHARED = ("get", "set")
MODEL = ("set_time", "set_states", "get_derivatives", "enter_continuous_time_mode", "get_states")
SAVING = ("size", "serialize")


class Refusing:
    """A library one of whose calls is refused once it is armed; `after` has what is called then."""

    def __init__(self, refused, status):
        self.armed, self.after, self._refused, self._status = False, None, refused, status

    def of(self, calls, names):
        """Return a dataclass of calls with some of them watched."""
        return replace(calls, **{name: self._watched(name, getattr(calls, name)) for name in names})

    def _watched(self, name, call):
        def watched(*arguments):
            if self.after is not None:
                self.after.append(name)
            elif self.armed and name == self._refused:
                self.after = []
                return self._status
            return call(*arguments)

        return watched

    def load(self, archive, folder, kind):
        """Load the library as `open_plants` does."""
        library = Library(archive, folder, kind)
        library.calls = self.of(library.calls, SHARED)
        bind = library.bind

        def watching(binder):
            names = {bind_model: MODEL, bind_states: SAVING}.get(binder, ())
            return self.of(bind(binder), names) if names else bind(binder)

        library.bind = watching
        return library


def body():
    none, one = np.zeros(2), np.eye(2)
    still = Disturbance(none, none, *np.zeros((3, 2, 0)))
    return Body(1, {}, one, one, still, none, none, none, none)


@pytest.mark.parametrize("status", [ERROR, FATAL, NO_STATUS])
@pytest.mark.parametrize("solver", ["rk4", "cvode"])
@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("refused", [*SHARED, *MODEL[:3]])
def test_a_solver_stops_at_a_call_that_is_refused(refused, fmi, solver, status):
    refusing = Refusing(refused, status)
    with ExitStack() as stack:
        archive = open_archive(build("two_link_arm", fmi))
        plants = open_plants(stack, archive, [body()], {}, Driving(solver=solver), refusing.load)
        refusing.armed = True
        with pytest.raises(StepError, match=r"robot 1 .* ended with (Error|Fatal|status -1)"):
            plants.advance(0.0, 0.1)
        assert refusing.after == []


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("refused", ["enter_continuous_time_mode", "get_states", "get"])
def test_an_event_stops_at_a_call_that_is_refused(refused, fmi):
    refusing = Refusing(refused, ERROR)
    with ExitStack() as stack:
        archive = open_archive(build("two_link_arm", fmi))
        plants = open_plants(stack, archive, [body()], {}, Driving(solver="rk4"), refusing.load)
        refusing.armed = True
        with pytest.raises(StepError, match="an event ended with Error"):
            plants.hold(np.ones((1, 2)), np.ones((1, 2)))
        assert refusing.after == []


def test_after_a_refused_state_size_no_state_is_requested():
    refusing = Refusing("size", ERROR)
    with ExitStack() as stack:
        archive = open_archive(build("two_link_arm"))
        plants = open_plants(stack, archive, [body()], {}, Driving(), refusing.load)
        refusing.armed = True
        with pytest.raises(StepError, match="saving its state ended with Error"):
            plants.save()
        assert refusing.after == []
