"""dx/dt = f(t, x) by CVODE: backward differentiation of varying order, errors within a tolerance.

The library is the one that comes with FMPy (SUNDIALS 7, CVODE's user guide, section 5). It is bound
here anew, because FMPy's own class goes on after a failed evaluation, evaluates beyond the time
that it is asked for, and frees only a part of its memory.
"""

from collections.abc import Callable
from contextlib import ExitStack
from ctypes import (
    CFUNCTYPE,
    byref,
    c_char_p,
    c_double,
    c_int,
    c_int64,
    c_long,
    c_void_p,
    memmove,
)
from typing import Any

from fmpy.sundials import libraries as sundials

from nrs_cosim.plant_fmu.drives.exchange_instance import Exchanged
from nrs_cosim.plant_fmu.fmi.calls import DISCARD, bind, is_fine
from nrs_cosim.plant_fmu.plants import Array

MAX_STEPS = 100_000
"""Of the solver, between two times that it is asked for."""
TOO_CLOSE = 1e-14
"""s, or relative to t where that is more: CVODE cannot make a first step so small."""

_BDF, _NORMAL, _ONE_STEP, _ROOT_FOUND = 2, 1, 2, 2
_TRY_SMALLER, _GIVE_UP = 1, -1

_Evaluation = CFUNCTYPE(c_int, c_double, c_void_p, c_void_p, c_void_p)
_Complaint = CFUNCTYPE(None, c_int, c_char_p, c_char_p, c_char_p, c_int, c_void_p, c_void_p)

_core, _cvode = sundials.sundials_core, sundials.sundials_cvode
_any = c_void_p
_new_context = bind(_core, "SUNContext_Create", c_int, _any)
_free_context = bind(_core, "SUNContext_Free", _any)
_clear_complaints = bind(_core, "SUNContext_ClearErrHandlers", _any)
_hear_complaints = bind(_core, "SUNContext_PushErrHandler", _any, _Complaint, _any)
_serial = sundials.sundials_nvecserial
_new_vector = bind(_serial, "N_VNew_Serial", c_int64, _any, result=_any)
_address = bind(_serial, "N_VGetArrayPointer_Serial", _any, result=_any)
_free_vector = bind(_serial, "N_VDestroy_Serial", _any, result=None)
_matrix = sundials.sundials_sunmatrixdense
_new_matrix = bind(_matrix, "SUNDenseMatrix", c_int64, c_int64, _any, result=_any)
_free_matrix = bind(_core, "SUNMatDestroy", _any, result=None)
_linear = sundials.sundials_sunlinsoldense
_new_linear = bind(_linear, "SUNLinSol_Dense", _any, _any, _any, result=_any)
_free_linear = bind(_core, "SUNLinSolFree", _any)
_create = bind(_cvode, "CVodeCreate", c_int, _any, result=_any)
_free = bind(_cvode, "CVodeFree", _any, result=None)
_begin = bind(_cvode, "CVodeInit", _any, _Evaluation, c_double, _any)
_begin_again = bind(_cvode, "CVodeReInit", _any, c_double, _any)
_set_tolerances = bind(_cvode, "CVodeSVtolerances", _any, c_double, _any)
_set_linear = bind(_cvode, "CVodeSetLinearSolver", _any, _any, _any)
_set_max_steps = bind(_cvode, "CVodeSetMaxNumSteps", _any, c_long)
_set_stop = bind(_cvode, "CVodeSetStopTime", _any, c_double)
_find_roots = bind(_cvode, "CVodeRootInit", _any, c_int, _Evaluation)
_allow_flat_roots = bind(_cvode, "CVodeSetNoInactiveRootWarn", _any)
_solve = bind(_cvode, "CVode", _any, c_double, _any, _any, c_int)


class Cvode:
    """See `plant_fmu.drives.model_exchange.Solver`; `close` frees what it holds in SUNDIALS."""

    def __init__(self, robot: Exchanged, rtol: float) -> None:
        """Solve within a relative tolerance, and `rtol` times the states' nominal values."""
        self._robot, self._rtol = robot, rtol
        # An FMU that wants to hear of each step of the solver is told of one after the other.
        self._task = _ONE_STEP if robot.tells_steps else _NORMAL
        self._fault: BaseException | None = None
        self._complaint = ""
        self._reached = c_double()
        # Freed in reverse: the solver before what it was given, and the context last.
        self._memory = ExitStack()
        # SUNDIALS keeps pointers to these three, so that they live as long as the solver.
        self._evaluations = (
            _Evaluation(self._evaluation(robot.derivatives, "the derivatives", _address)),
            _Evaluation(self._evaluation(robot.signs, "the event indicators", int)),
        )
        self._logged = _Complaint(self._log)
        try:
            self._open(robot)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free all that it holds in SUNDIALS."""
        self._memory.close()

    def restart(self) -> None:
        """Forget the past, and begin at the robot's time and states."""
        self._load()
        self._expect(_begin_again(self._solver, self._robot.time, self._states))

    def advance(self, until: float) -> bool:
        """Move the robot up to a time or just past its first event."""
        robot = self._robot
        event = False
        while robot.time < until and not event:
            if until - robot.time <= TOO_CLOSE * max(1.0, abs(until)):
                return robot.complete(until)
            # Beyond this time the FMU must not be evaluated: its inputs may jump there.
            self._expect(_set_stop(self._solver, until))
            flag = _solve(self._solver, until, self._states, byref(self._reached), self._task)
            self._expect(flag)
            memmove(robot.states_at, self._states_at, robot.states.nbytes)
            event = robot.complete(self._reached.value) or flag == _ROOT_FOUND
        return event

    def _open(self, robot: Exchanged) -> None:
        """Make what is held in SUNDIALS, and begin at the robot's time and states."""
        derivatives, indicators = self._evaluations
        size, context = robot.states.size, self._new_context()
        self._states, self._allowed = (
            self._hold(_new_vector(size, context), _free_vector) for _ in range(2)
        )
        self._states_at, self._allowed_at = _address(self._states), _address(self._allowed)
        matrix = self._hold(_new_matrix(size, size, context), _free_matrix)
        linear = self._hold(_new_linear(self._states, matrix, context), _free_linear)
        self._solver = c_void_p(_create(_BDF, context))
        self._memory.callback(lambda: _free(byref(self._solver)))
        self._load()
        for status in (
            _begin(self._solver, derivatives, robot.time, self._states),
            _set_tolerances(self._solver, self._rtol, self._allowed),
            _set_linear(self._solver, linear, matrix),
            _set_max_steps(self._solver, MAX_STEPS),
            _find_roots(self._solver, robot.indicators.size, indicators),
            _allow_flat_roots(self._solver),  # an indicator may stay 0
        ):
            self._expect(status)

    def _load(self) -> None:
        """Copy the robot's states, and the errors allowed in them, to where CVODE finds them."""
        robot = self._robot
        allowed: Array = self._rtol * robot.nominals()
        memmove(self._states_at, robot.states_at, robot.states.nbytes)
        memmove(self._allowed_at, allowed.ctypes.data, allowed.nbytes)

    def _evaluation(
        self, evaluate: Callable[[float, int, int], int], what: str, address: Callable[[Any], int]
    ) -> Callable[[float, int, Any, Any], int]:
        """Return an evaluation for CVODE, which must not be left by an exception."""

        def evaluation(time: float, states: int, values: Any, _user: Any) -> int:
            try:
                status = evaluate(time, _address(states), address(values))
                if is_fine(status):
                    return 0
                if status == DISCARD:
                    return _TRY_SMALLER
                self._fault = self._robot.refusal(f"evaluating {what} at t = {time:g} s", status)
            except BaseException as error:  # such as KeyboardInterrupt: C would swallow it
                self._fault = error
            return _GIVE_UP

        return evaluation

    def _log(self, *complaint: Any) -> None:
        self._complaint = complaint[3].decode("utf-8", "replace")

    def _expect(self, flag: int) -> None:
        """Raise what went wrong during a call to CVODE, if anything did."""
        if flag >= 0:
            return
        if self._fault:
            raise self._fault
        raise self._robot.failure(f"CVODE failed with {flag}: {self._complaint}")

    def _new_context(self) -> c_void_p:
        context = c_void_p()
        _new_context(0, byref(context))
        self._memory.callback(lambda: _free_context(byref(context)))
        _clear_complaints(context)
        _hear_complaints(context, self._logged, None)
        return context

    def _hold(self, thing: int, end: Callable[[int], Any]) -> int:
        self._memory.callback(end, thing)
        return thing
