"""The FMU holds the PD loop: one doStep an interval, exact to the FMU's own tolerance.

Its inputs are ε(t_k⁺) and υ(t_k⁺), and it extrapolates the reference itself.
"""

from collections.abc import Mapping, Sequence
from ctypes import c_void_p
from itertools import starmap
from typing import Any

import numpy as np

from plant_fmu.calls import STATUS, WARNING, c_references
from plant_fmu.errors import FmuError, StepError
from plant_fmu.library import Library
from plant_fmu.plants import Array, Start
from plant_fmu.variables import Quantity, find_quantity, references

REFERENCE = ("position_ref", "velocity_ref")
STATE = ("q", "qd", "tau_applied")


class ReferenceDrivenPlants:
    """Plants driven by `position_ref` and `velocity_ref`; see `plant_fmu.plants.Plants`."""

    def __init__(
        self, library: Library, m: int, starts: Sequence[Start], names: Mapping[str, str]
    ) -> None:
        """Instantiate and initialise one plant for each start; `FmuError` says what is wrong.

        `names` gives the FMU's name for a quantity of ours where it has another.
        """
        self._library = library
        self._robots = [start.robot for start in starts]
        self._reference = np.zeros((len(starts), 2 * m))
        self._state = np.zeros((len(starts), 3 * m))
        self.q, self.qd, self.tau = (self._state[:, i * m : (i + 1) * m] for i in range(3))
        self._handles = [library.instantiate(self._name(start.robot)) for start in starts]
        inputs, outputs = (
            [self._find(name, names, m) for name in group] for group in (REFERENCE, STATE)
        )
        self._set = self._bound(inputs, self._reference)
        self._get = self._bound(outputs, self._state)
        for handle, start in zip(self._handles, starts, strict=True):
            self._initialise(handle, start, names)
        self._check(list(starmap(library.calls.get, self._get)), "its states", 0.0)

    def hold(self, position: Array, velocity: Array) -> None:
        """Take new references (rows, m) from now on."""
        m = position.shape[1]
        self._reference[:, :m] = position
        self._reference[:, m:] = velocity
        self._check(list(starmap(self._library.calls.set, self._set)), "its reference", 0.0)

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        calls = self._library.calls
        do_step, tail = calls.step, calls.step_tail
        self._check([do_step(handle, start, step, *tail) for handle in self._handles], "", start)
        self._check(list(starmap(calls.get, self._get)), "", start + step)
        if not np.isfinite(self._state).all():
            row = int(np.flatnonzero(~np.isfinite(self._state).all(axis=1))[0])
            raise StepError(
                f"{self._who(row)} at t = {start + step:g} s: its state is not finite: "
                f"q = {self.q[row].tolist()}, qd = {self.qd[row].tolist()}"
            )

    def _initialise(self, handle: int, start: Start, names: Mapping[str, str]) -> None:
        library, name = self._library, self._name(start.robot)
        for ours, value in start.values.items():
            quantity = self._find(ours, names, None)
            values = np.ascontiguousarray(value, float).ravel()
            if len(values) != quantity.size:
                raise FmuError(
                    f"{library.archive.label}: {quantity.name} takes {quantity.size} numbers, "
                    f"got {len(values)}"
                )
            arguments = self._arguments(handle, [quantity], values.ctypes.data)
            library.expect_ok(name, f"setting {quantity.name}", library.calls.set(*arguments))
        library.expect_ok(name, "initialisation", library.calls.enter_initialization(handle))
        library.expect_ok(name, "initialisation", library.calls.exit_initialization(handle))

    def _find(self, name: str, names: Mapping[str, str], size: int | None) -> Quantity:
        quantity = find_quantity(self._library.archive, names.get(name, name))
        if size is not None and quantity.size != size:
            raise FmuError(
                f"{self._library.archive.label}: {quantity.name} holds {quantity.size} numbers, "
                f"expected {size}, one for each of the target's axes"
            )
        return quantity

    def _bound(self, quantities: Sequence[Quantity], rows: Array) -> list[tuple[Any, ...]]:
        """Return for each robot the arguments that pass these quantities from or to its row."""
        stride, base = rows.strides[0], rows.ctypes.data
        return [
            self._arguments(handle, quantities, base + row * stride)
            for row, handle in enumerate(self._handles)
        ]

    def _arguments(
        self, handle: int, quantities: Sequence[Quantity], address: int
    ) -> tuple[Any, ...]:
        which = c_references(references(quantities))
        count = (sum(q.size for q in quantities),) if self._library.calls.counts_values else ()
        return (handle, which, len(which), c_void_p(address), *count)

    def _check(self, statuses: list[int], what: str, seconds: float) -> None:
        if max(statuses, default=0) <= WARNING:
            return
        row = next(i for i, status in enumerate(statuses) if status > WARNING)
        raise StepError(
            f"{self._who(row)} at t = {seconds:g} s: {what or 'a step'} ended with "
            f"{STATUS[statuses[row]]}{self._library.last_words(self._name(self._robots[row]))}"
        )

    def _who(self, row: int) -> str:
        return f"robot {self._robots[row]} ({self._library.archive.name})"

    @staticmethod
    def _name(robot: int) -> str:
        return f"robot {robot}"
