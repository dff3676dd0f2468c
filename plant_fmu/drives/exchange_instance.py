"""One robot in Model Exchange: dx/dt = f(t, x, tau + tau_d), with tau of the law at (t, q, qd, z).

q and qd are the FMU's variables at (t, x), whatever its states are, after which come those of the
law, z (m,), where it integrates. Without a law there is no tau, and what is read may be called
otherwise. Events are handled as FMI asks (2.0, section 3.2.2; 3.0, section 3.2.1): planned ones by
their time, state events by the sign of the indicators at (t, x), step events as the FMU wants after
a step, and jumps of the reference.
"""

from collections.abc import Sequence
from ctypes import c_double

import numpy as np

from nrs_cosim.plant_fmu.archives.quantities import NumberLayout, View
from nrs_cosim.plant_fmu.drives.inverse_dynamics import model_torque, needs_model
from nrs_cosim.plant_fmu.drives.pd_law import Law
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.fmi.calls import is_fine, unless_fine
from nrs_cosim.plant_fmu.fmi.instances import Instances
from nrs_cosim.plant_fmu.fmi.model_calls import ModelCalls
from nrs_cosim.plant_fmu.plants import PD_ALONE, Array, Control

ITERATIONS = 1000
"""After so many iterations of one event it is taken to have no end."""


class Exchanged:
    """A robot's instance at `time` and `states`; `next_event` is planned by the FMU, s.

    States, derivatives and indicators are passed by the address of an array of doubles, and the
    calls that a solver makes most answer with an FMI status. After one that is not fine no other is
    made (FMI 2.0, section 2.1.3; FMI 3.0, section 2.3).
    """

    def __init__(
        self,
        instances: Instances,
        row: int,
        calls: ModelCalls,
        law: Law | None,
        m: int,
        outputs: Sequence[str],
        control: Control = PD_ALONE,
    ) -> None:
        """Take the instance of a row, initialised; the law is that of this robot alone.

        The outputs are of m numbers each. `control` is what the law has beside PD.
        """
        library = instances.library
        description = library.archive.description
        self._instances, self._row, self._calls, self._law = instances, row, calls, law
        self._handle = instances.handles[row]
        self.time, self.next_event = 0.0, np.inf
        self.state, self._effort = np.zeros((1, 2 * m)), np.zeros((1, m))
        self._outputs = View([instances.vector(ours, m) for ours in outputs], self.state)
        self._read = instances.arguments(row, self._outputs, 0)
        if law:
            self._input = View([instances.vector("tau", m)], self._effort)
            self._write = instances.arguments(row, self._input, 0)
            # What of the input's variables is not ours is written back as it was at first.
            if not self._input.is_complete:
                self._expect(library.calls.get(*self._write), "access to tau")
        self._tau, self._control = np.zeros((1, m)), control
        self._integrates = law is not None and "ki" in control.wanted()
        self._integral_rate = np.zeros((1, m))
        self._rate_places = np.zeros(0, int)
        if law and needs_model(control):
            velocity = instances.vector(outputs[1], m)
            self._rate_places = np.array(instances.states_of(outputs[1], m), int)
            self._rate_factor = NumberLayout.of([velocity]).factor
            if not self._rate_places.size:
                raise FmuError(
                    f"{library.archive.label}: {velocity.name} is no state of the FMU's, by whose "
                    "rate the controller could tell its inertia"
                )
        self._own_states = description.numberOfContinuousStates
        self.states = np.zeros(self._own_states + m * self._integrates)
        self._rates = np.zeros(self._own_states)
        self.indicators = np.zeros(description.numberOfEventIndicators)
        self.states_at = self.states.ctypes.data
        self.indicators_at = self.indicators.ctypes.data
        self.without_nominal: set[int] = set()
        """The numbers of states, from 1, that the FMU gave no positive nominal value."""
        self.tells_steps = bool(library.interface.needsCompletedIntegratorStep)
        """Whether the FMU wants to hear of each step of the solver."""

    def begin(self) -> None:
        """Leave initialisation, which ends in event mode."""
        self._iterate()

    def start_at(self, q_qd: Array, places: Sequence[int]) -> None:
        """Set those of q and qd, (2 m,), that start elsewhere, at the states that they are.

        A place of −1 is that of none. They can be set after initialisation alone (FMI 2.0, section
        3.2.1; FMI 3.0, section 3.2.1).
        """
        where = np.array(places)
        wrong = (where >= 0) & ~np.isclose(self.state[0], q_qd, rtol=1e-9, atol=1e-9)
        if wrong.any():
            self.states[where[wrong]] = self._outputs.in_units(q_qd)[wrong]
            self._expect(self.move(self.time, self.states_at), "setting the states to start with")
            self.event()

    def event(self) -> None:
        """Handle an event at this time: a planned one, one that was found, or a jump of tau."""
        self._expect(self._calls.enter_event_mode(self._handle), "entering event mode")
        # Equations are asked for more than their rates in continuous time alone.
        if not self._rate_places.size:
            self._expect(self._apply_law(self.time, self.states_at), "an event")
        self._iterate()

    def move(self, time: float, states: int) -> int:
        """Bring the FMU to a time and states, and give it the law's torque there."""
        handle, calls = self._handle, self._calls
        return (
            unless_fine(calls.set_time(handle, time))
            or unless_fine(calls.set_states(handle, states, self._own_states))
            or self._apply_law(time, states)
        )

    def derivatives(self, time: float, states: int, derivatives: int) -> int:
        """Evaluate dx/dt at a time and states."""
        get = self._calls.get_derivatives
        status = unless_fine(self.move(time, states)) or get(
            self._handle, derivatives, self._own_states
        )
        if self._integrates:
            self._numbers(derivatives)[self._own_states :] = self._integral_rate[0]
        return status

    def signs(self, time: float, states: int, indicators: int) -> int:
        """Evaluate the event indicators at a time and states."""
        get = self._calls.get_indicators
        moved = unless_fine(self.move(time, states))
        return moved or get(self._handle, indicators, self.indicators.size)

    def nominals(self) -> Array:
        """Return the sizes (states,) that the FMU expects its states to have, 1 where that is none.

        They must be positive (FMI 2.0, section 3.2.1; FMI 3.0, section 3.1.1).
        """
        sizes = np.ones(self.states.size)
        status = self._calls.get_nominals(self._handle, sizes.ctypes.data, self._own_states)
        self._expect(status, "asking for nominal values")
        wrong = ~(np.isfinite(sizes) & (sizes > 0))
        self.without_nominal.update((np.flatnonzero(wrong) + 1).tolist())
        sizes[wrong] = 1.0
        return sizes

    def arrive(self, time: float) -> None:
        """Take a time and the states as they are for the robot's own."""
        self.time = time
        self._expect(self.move(time, self.states_at), "moving to new states")
        if not np.isfinite(self.state).all():
            raise self.failure(f"its outputs are not finite: {self.state[0].tolist()}")

    def complete(self, time: float) -> bool:
        """Arrive by a step of the solver, and return whether the FMU wants an event."""
        self.arrive(time)
        if not self.tells_steps:
            return False
        completed = self._calls.complete_step(self._handle)
        self._expect(completed.status, "completing a step of the solver")
        self._expect_to_go_on(completed.terminate)
        return completed.event

    def torque(self) -> Array:
        """Return the law's torque now, (m,), N m, without the disturbance."""
        if not self._law:
            return np.zeros(self.state.size // 2)
        now = self._tau if self._is_more_than_pd else self._law.torque(self.time, self.state)
        torque: Array = now[0]
        return torque

    def failure(self, cause: str) -> StepError:
        """Return the error that names the robot, the FMU, the time and the cause."""
        return self._instances.failure(self._row, self.time, cause)

    def refusal(self, act: str, status: int) -> StepError:
        """Return the error of an act that ended badly."""
        return self._instances.refusal(self._row, self.time, act, status)

    def _iterate(self) -> None:
        """Iterate the discrete states until they rest, and go on in continuous time."""
        handle, calls = self._handle, self._calls
        for _ in range(ITERATIONS):
            update = calls.update(handle)
            self._expect(update.status, "an event")
            self._expect_to_go_on(update.terminate)
            if not update.again:
                break
        else:
            raise self.failure(f"an event did not come to rest in {ITERATIONS} iterations")
        self.next_event = update.next_event
        status = (
            unless_fine(calls.enter_continuous_time_mode(handle))
            or unless_fine(calls.get_states(handle, self.states_at, self._own_states))
            or self._apply_law(self.time, self.states_at)
        )
        self._expect(status, "an event")

    def _apply_law(self, time: float, states: int) -> int:
        """Read the outputs, and give the FMU the torque that the law has for them."""
        calls = self._instances.library.calls
        read = unless_fine(calls.get(*self._read))
        if read:
            return read
        self._outputs.take()
        if not self._law:
            return 0
        if self._is_more_than_pd:
            self._effort[:] = self._whole_effort(self._law, time, self._numbers(states))
        else:
            self._effort[:] = self._law.effort(time, self.state)
        self._input.give()
        return calls.set(*self._write)

    @property
    def _is_more_than_pd(self) -> bool:
        return self._integrates or self._rate_places.size > 0

    def _numbers(self, address: int) -> Array:
        """Return what is at an address, as large as the states."""
        return np.ctypeslib.as_array((c_double * self.states.size).from_address(address))

    def _whole_effort(self, law: Law, time: float, states: Array) -> Array:
        """Return the effort (1, m) of a law that is more than PD, and find the integral's rate."""
        own = self._own_states
        asked = law.asked(time, self.state, states[None, own:] if self._integrates else None)
        if self._rate_places.size:
            asked = self._of_model(law, asked[0], states[:own].copy())[None]
        self._tau = law.within_limits(asked)
        if self._integrates:
            self._integral_rate = law.integral_rate(time, self.state, asked - self._tau)
        return law.disturbed(time, self._tau)

    def _of_model(self, law: Law, u: Array, here: Array) -> Array:
        """Return what is asked, (m,), of a law that asks the equations, at the FMU's states."""
        still = here.copy()
        still[self._rate_places] = 0.0

        def accelerate(torque: Array, at_rest: bool) -> Array:
            self._effort[0] = torque
            self._input.give()
            handle, calls, n = self._handle, self._calls, self._own_states
            at = still if at_rest else here
            status = (
                unless_fine(self._instances.library.calls.set(*self._write))
                or unless_fine(calls.set_states(handle, at.ctypes.data, n))
                or calls.get_derivatives(handle, self._rates.ctypes.data, n)
            )
            self._expect(status, "evaluating the derivatives")
            return self._rate_factor * self._rates[self._rate_places]

        asked = model_torque(self._control, u, law.reference[0, 2 * u.size :], accelerate)
        if self._control.gravity_compensation:  # the last that was asked for was at rest
            self._expect(
                self._calls.set_states(self._handle, here.ctypes.data, here.size),
                "evaluating the derivatives",
            )
        return asked

    def _expect(self, status: int, act: str) -> None:
        if not is_fine(status):
            raise self.refusal(act, status)

    def _expect_to_go_on(self, terminate: bool) -> None:
        if terminate:
            raise self.failure("the FMU ended the simulation")
