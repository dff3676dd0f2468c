"""Each robot is an instance of its FMU; what is asked of one is asked of all, in rows' order.

A call that fails is an error that names the robot, the FMU, the time and the cause.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Never

import numpy as np

from nrs_cosim.bus.errors import Cause
from nrs_cosim.plant_fmu.archives.families import Spec, as_toml
from nrs_cosim.plant_fmu.archives.quantities import STARTS, TYPES, Quantity, View
from nrs_cosim.plant_fmu.archives.starts import continuous_states, start_parameters
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.errors import FmuError, StartError, StepError
from nrs_cosim.plant_fmu.fmi.assignment import StartValues, assignments, sizes_of, unsettable
from nrs_cosim.plant_fmu.fmi.batch_calls import CalledRounds, EarlyEnd, Rounds, arguments
from nrs_cosim.plant_fmu.fmi.calls import FATAL, answer, c_references, is_fine
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.native.batch_calls import (
    NativeRounds,
    StepAddresses,
    native_rounds,
)
from nrs_cosim.plant_fmu.plants import Array, Body, called

Transfer = Callable[[float], None]
"""Moves rows of an array to or from the FMUs at a time in s; `StepError` when one refuses."""
Advance = Callable[[float, float], None]
"""Steps the FMUs from a time by a step, in s, and reads them; `StepError` when one refuses."""


class Instances:
    """The robots' instances of one loaded FMU."""

    def __init__(self, library: Library, bodies: Sequence[Body], names: Mapping[str, Spec]) -> None:
        """Instantiate the FMU for each robot; `FmuError` with its words when it refuses.

        `names` are what the user wrote for quantities of ours.
        """
        self.library, self._names = library, names
        self.robots = [body.robot for body in bodies]
        names_of = [called(robot) for robot in self.robots]
        self.handles = list(map(library.instantiate, names_of))
        native = native_rounds(library, self.handles, names_of)
        self.rounds: Rounds = native or CalledRounds(library, self.handles)
        self._sizes = sizes_of(assignments(library.archive, bodies[0].parameters))

    def vector(self, ours: str, m: int) -> Quantity:
        """Return a quantity that must hold m numbers."""
        archive = self.library.archive
        return find_quantity(archive, ours, self._names, size=m, sizes=self._sizes)

    def states_of(self, ours: str, m: int) -> tuple[int, ...]:
        """Return which continuous states m numbers are; empty unless all of them are."""
        return continuous_states(self.library.archive, self.vector(ours, m), self._sizes)

    def takes_start(self, ours: str, m: int) -> bool:
        """Whether FMI lets a start, or what says it, be set before initialisation."""
        references = {part.reference for part in self.vector(ours, m).parts}
        return STARTS[ours] in self._names or not any(
            unsettable(variable)
            for variable in self.library.archive.description.modelVariables
            if variable.type in TYPES and variable.valueReference in references
        )

    def initialise(self, bodies: Sequence[Body], values: Sequence[Mapping[str, Any]]) -> None:
        """Set each robot's parameters and its values of our quantities; end its initialisation."""
        calls = self.library.calls
        for row, (body, start_values) in enumerate(zip(bodies, values, strict=True)):
            handle = self.handles[row]
            assigned = assignments(self.library.archive, body.parameters)
            for assignment in assigned:
                for status in assignment.acts(calls, handle):
                    self._expect_ok(row, f"setting {assignment.name}", status)
            if start_values:
                self._start(row, start_values, assigned)
            self._expect_ok(row, "initialisation", calls.enter_initialization(handle, 0.0))
            self._expect_ok(row, "initialisation", calls.exit_initialization(handle))

    def reset(self) -> None:
        """Return each FMU to where it was when it was instantiated."""
        for row, handle in enumerate(self.handles):
            self._expect_ok(row, "a reset", self.library.calls.reset(handle))

    def writes(self, quantities: Sequence[Quantity], rows: Array) -> Transfer:
        """Return the act that gives each FMU its row of an array (robots, numbers), in SI."""
        view, what = View(quantities, rows), _listed(quantities)
        # What of the variables is not ours is written as it was read before the first time.
        if not view.is_complete:
            self._transfer(view, what, setting=False)(0.0)
        move = self._transfer(view, what, setting=True)

        def write(seconds: float) -> None:
            view.give()
            move(seconds)

        return write

    def reads(self, quantities: Sequence[Quantity], rows: Array) -> Transfer:
        """Return the act that fills an array's rows (robots, numbers) from the FMUs, in SI."""
        view = View(quantities, rows)
        move = self._transfer(view, _listed(quantities), setting=False)

        def read(seconds: float) -> None:
            move(seconds)
            view.take()

        return read

    def steps(self, quantities: Sequence[Quantity], rows: Array) -> Advance:
        """Return the act that steps each FMU, and then fills rows (robots, numbers) as `reads`."""
        view = View(quantities, rows)
        advance = self.rounds.advance(view)

        def step(start: float, step: float) -> None:
            self.expect_stepped(advance(start, step), quantities, start, step)
            view.take()

        return step

    def native(
        self,
        given: tuple[Sequence[Quantity], Array],
        read: tuple[Sequence[Quantity], Array],
    ) -> "NativeSteps | str":
        """Return what other native code sets and steps them by, or why it cannot.

        Both are quantities, and rows of them as an array (robots, numbers).
        """
        rounds, views = self.rounds, (View(*given), View(*read))
        if not isinstance(rounds, NativeRounds):
            return "nothing can be compiled"
        if not all(view.is_direct for view in views):
            return "an FMU has other numbers than ours, or in another order"
        return NativeSteps(self, given, read, rounds, rounds.addresses(*views))

    def expect_stepped(
        self, end: EarlyEnd | None, read: Sequence[Quantity], start: float, step: float
    ) -> None:
        """Raise `StepError` for the robot whose FMU ended a round of steps, in s."""
        if end and end.stepping:
            raise self.refusal(end.row, start, f"a step of {step:g} s", end.status)
        self.expect_all(end, f"access to {_listed(read)}", start + step)

    def arguments(self, row: int, view: View, at: int) -> tuple[Any, ...]:
        """Return what `get` and `set` are told of a row's FMU, and of a row of its own numbers."""
        which = c_references(view.references)
        return arguments(self.library.calls, self.handles[row], which, view, at)

    def expect_all(self, end: EarlyEnd | None, act: str, seconds: float) -> None:
        """Raise `StepError` for the robot whose FMU ended a round."""
        if end:
            raise self.refusal(end.row, seconds, act, end.status)

    def expect_finite(self, rows: Array, seconds: float) -> None:
        """Raise `StepError` for the first robot of rows (robots, numbers) with a non-finite one."""
        finite = np.isfinite(rows)
        if not finite.all():
            row = int(np.flatnonzero(~finite.all(axis=1))[0])
            raise self.failure(row, seconds, f"its outputs are not finite: {rows[row].tolist()}")

    def expect_start(self, bodies: Sequence[Body], state: Array) -> None:
        """Raise `FmuError` where a robot's q and qd (robots, 2 m) are not what it was told."""
        for name, got in zip(("q", "qd"), np.split(state, 2, axis=1), strict=True):
            start_values = np.array([getattr(body, name) for body in bodies])
            good = np.isclose(got, start_values, rtol=1e-9, atol=1e-9).all(axis=1)
            if not good.all():
                row = int(np.flatnonzero(~good)[0])
                own = () if STARTS[name] in self._names else self._start_names(name, got[row])
                instead = ""
                if own:
                    line = f"{STARTS[name]} = {as_toml(own)}"
                    instead = f"; a parameter seems to say it: plant.variables = {{ {line} }}"
                raise StartError(
                    f"{self.library.archive.label}: {name} of robot {bodies[row].robot} was to "
                    f"start at {start_values[row].tolist()} (initial.{name}), but starts at "
                    f"{got[row].tolist()}; what stands for {name} must be a state whose start "
                    f"can be set{instead}",
                    {STARTS[name]: own} if own else {},
                )

    def _start_names(self, ours: str, found: Array) -> tuple[str, ...]:
        """Return the parameters where a quantity may start that starts at `found`, if they show."""
        quantity = self.vector(ours, len(found))
        return start_parameters(self.library.archive, quantity, found.tolist())

    def refusal(self, row: int, seconds: float, act: str, status: int) -> StepError:
        """Return the error of an act that ended badly, with the FMU's last words."""
        return self.failure(row, seconds, f"{act} {self._ending(row, status)}")

    def failure(self, row: int, seconds: float, cause: str) -> StepError:
        """Return the error that names a row's robot, the FMU, the time and the cause."""
        fmu = self.library.archive.label
        robot = self.robots[row]
        return StepError(
            f"{called(robot)} ({fmu}) at t = {seconds:g} s: {cause}",
            Cause(StepError.kind, time_ns=round(seconds * 1e9), robot=robot),
        )

    def _transfer(self, view: View, what: str, *, setting: bool) -> Transfer:
        exchange = self.rounds.exchange(view, setting=setting)
        return lambda seconds: self.expect_all(exchange(), f"access to {what}", seconds)

    def _start(
        self, row: int, start_values: Mapping[str, Any], assigned: Sequence[StartValues]
    ) -> None:
        """Set one robot's values of our quantities, in SI, all at once."""
        sizes = sizes_of(assigned)
        archive = self.library.archive
        given = {
            STARTS[ours] if STARTS.get(ours) in self._names else ours: value
            for ours, value in start_values.items()
        }
        values = {ours: np.ravel(np.asarray(value, float)) for ours, value in given.items()}
        quantities = [
            find_quantity(archive, ours, self._names, size=len(value), sizes=sizes)
            for ours, value in values.items()
        ]
        view = View(quantities, np.concatenate(list(values.values()))[None])
        for assignment in assigned:
            is_ours = assignment.type in TYPES and set(view.references) & set(assignment.references)
            if is_ours:
                raise FmuError(
                    f"{archive.label}: parameter {assignment.name} is among "
                    f"{_listed(quantities)}, which the scenario gives in tables of their own"
                )
        view.give()
        status = self.library.calls.set(*self.arguments(row, view, 0))
        self._expect_ok(row, f"setting {_listed(quantities)}", status)

    def _expect_ok(self, row: int, act: str, status: int) -> None:
        if not is_fine(status):
            who, fmu = called(self.robots[row]), self.library.archive.label
            raise FmuError(f"{fmu}: {act} of {who} {self._ending(row, status)}")

    def _ending(self, row: int, status: int) -> str:
        """Say how a call ended, with the FMU's last words; after Fatal there is no other."""
        self.library.is_dead |= status == FATAL
        return f"ended with {answer(status)}{self.library.last_words(called(self.robots[row]))}"


@dataclass(frozen=True, slots=True, eq=False)
class NativeSteps:
    """Instances that other native code sets and steps; see `StepAddresses`."""

    instances: Instances
    given: tuple[Sequence[Quantity], Array]
    read: tuple[Sequence[Quantity], Array]
    _rounds: NativeRounds
    addresses: StepAddresses

    def raise_for(self, row: int, start: float, step: float, *, held: bool, stepped: bool) -> Never:
        """Raise `StepError` for a row whose call ended badly, or, `stepped`, is not finite."""
        instances, end = self.instances, self._rounds.early_end(row)
        if not held:
            instances.expect_all(end, f"access to {_listed(self.given[0])}", start)
        elif not stepped:
            instances.expect_stepped(end, self.read[0], start, step)
        instances.expect_finite(self.read[1], start + step)
        raise AssertionError  # one of them has raised


def _listed(quantities: Sequence[Quantity]) -> str:
    return ", ".join(quantity.name for quantity in quantities)
