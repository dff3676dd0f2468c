"""Each robot is an instance of its FMU; what is asked of one is asked of all, in rows' order.

A call that fails is an error that names the robot, the FMU, the time and the cause.
"""

from collections.abc import Callable, Mapping, Sequence
from ctypes import c_void_p
from itertools import starmap
from typing import Any

import numpy as np

from plant_fmu.calls import STATUS, WARNING, Call, c_references
from plant_fmu.errors import FmuError, StepError
from plant_fmu.library import Library
from plant_fmu.plants import Array
from plant_fmu.variables import Quantity, find_quantity, references

Transfer = Callable[[float], None]
"""Moves rows of an array to or from the FMUs at a time in s; `StepError` when one refuses."""


class Instances:
    """The robots' instances of one loaded FMU."""

    def __init__(self, library: Library, robots: Sequence[int]) -> None:
        """Instantiate the FMU for each robot; `FmuError` with its words when it refuses."""
        self.library = library
        self.robots = list(robots)
        self.handles = [library.instantiate(_name(robot)) for robot in robots]

    def initialise(
        self,
        values: Sequence[Mapping[str, Any]],
        names: Mapping[str, str],
        start: float = 0.0,
    ) -> None:
        """Set each robot's values by our names of the variables, and end its initialisation."""
        calls = self.library.calls
        for row, told in enumerate(values):
            for ours, value in told.items():
                self._start(row, names.get(ours, ours), value)
            handle = self.handles[row]
            self._expect_ok(row, "initialisation", calls.enter_initialization(handle, start))
            self._expect_ok(row, "initialisation", calls.exit_initialization(handle))

    def reset(self) -> None:
        """Return each FMU to where it was when it was instantiated."""
        for row, handle in enumerate(self.handles):
            self._expect_ok(row, "a reset", self.library.calls.reset(handle))

    def writes(self, quantities: Sequence[Quantity], rows: Array) -> Transfer:
        """Return the act that gives each FMU its row of an array (robots, numbers)."""
        return self._transfer(self.library.calls.set, quantities, rows)

    def reads(self, quantities: Sequence[Quantity], rows: Array) -> Transfer:
        """Return the act that fills an array's rows (robots, numbers) from the FMUs."""
        return self._transfer(self.library.calls.get, quantities, rows)

    def expect(self, statuses: list[int], act: str, seconds: float) -> None:
        """Raise `StepError` for the first robot whose FMU answered worse than a warning."""
        if max(statuses, default=0) <= WARNING:
            return
        row = next(row for row, status in enumerate(statuses) if status > WARNING)
        raise self.refusal(row, seconds, act, statuses[row])

    def expect_finite(self, rows: Array, seconds: float) -> None:
        """Raise `StepError` for the first robot with a non-finite number in its row."""
        finite = np.isfinite(rows)
        if not finite.all():
            row = int(np.flatnonzero(~finite.all(axis=1))[0])
            raise self.failure(row, seconds, f"its outputs are not finite: {rows[row].tolist()}")

    def refusal(self, row: int, seconds: float, act: str, status: int) -> StepError:
        """Return the error of an act that ended badly, with the FMU's last words."""
        return self.failure(
            row, seconds, f"{act} ended with {STATUS[status]}{self._last_words(row)}"
        )

    def failure(self, row: int, seconds: float, cause: str) -> StepError:
        """Return the error that names a row's robot, the FMU, the time and the cause."""
        fmu = self.library.archive.label
        return StepError(f"robot {self.robots[row]} ({fmu}) at t = {seconds:g} s: {cause}")

    def _transfer(self, call: Call, quantities: Sequence[Quantity], rows: Array) -> Transfer:
        which = c_references(references(quantities))
        count = (sum(q.size for q in quantities),) if self.library.calls.counts_values else ()
        stride, base = rows.strides[0], rows.ctypes.data
        arguments = [
            (handle, which, len(which), c_void_p(base + row * stride), *count)
            for row, handle in enumerate(self.handles)
        ]
        act = f"access to {', '.join(quantity.name for quantity in quantities)}"

        def transfer(seconds: float) -> None:
            self.expect(list(starmap(call, arguments)), act, seconds)

        return transfer

    def _start(self, row: int, name: str, value: Any) -> None:
        archive, calls = self.library.archive, self.library.calls
        quantity = find_quantity(archive, name)
        values = np.ascontiguousarray(value, float).ravel()
        if len(values) != quantity.size:
            raise FmuError(
                f"{archive.label}: {name} takes {quantity.size} numbers, got {len(values)}"
            )
        which = c_references(quantity.references)
        count = (len(values),) if calls.counts_values else ()
        status = calls.set(self.handles[row], which, len(which), values.ctypes.data, *count)
        self._expect_ok(row, f"setting {name}", status)

    def _expect_ok(self, row: int, act: str, status: int) -> None:
        if status > WARNING:
            raise FmuError(
                f"{self.library.archive.label}: {act} of robot {self.robots[row]} ended with "
                f"{STATUS[status]}{self._last_words(row)}"
            )

    def _last_words(self, row: int) -> str:
        return self.library.last_words(_name(self.robots[row]))


def _name(robot: int) -> str:
    return f"robot {robot}"
