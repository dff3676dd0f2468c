"""The FMU holds the PD loop: one doStep an interval, exact to the FMU's own tolerance.

Its inputs are ε(t_k⁺) and υ(t_k⁺), and it extrapolates the reference itself.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from plant_fmu.errors import FmuError
from plant_fmu.instances import Instances
from plant_fmu.library import Library
from plant_fmu.plants import Array, Body
from plant_fmu.variables import Quantity, find_quantity

REFERENCE = ("position_ref", "velocity_ref")
STATE = ("q", "qd", "tau_applied")
WAVES = ("amplitude", "frequency", "phase")


class ReferenceDrivenPlants:
    """Plants driven by `position_ref` and `velocity_ref`; see `plant_fmu.plants.Plants`."""

    def __init__(self, library: Library, bodies: Sequence[Body], names: Mapping[str, str]) -> None:
        """Instantiate and initialise one plant for each body; `FmuError` says what is wrong.

        `names` gives the FMU's name for a quantity of ours where it has another.
        """
        m, n = len(bodies[0].q), len(bodies)
        self._reference, self._state = np.zeros((n, 2 * m)), np.zeros((n, 3 * m))
        self.q, self.qd, self.tau = (self._state[:, i * m : (i + 1) * m] for i in range(3))
        self._instances = Instances(library, [body.robot for body in bodies])
        self._instances.initialise([_told(body, library, names) for body in bodies], names)
        inputs, outputs = (
            [_vector(library, names.get(name, name), m) for name in group]
            for group in (REFERENCE, STATE)
        )
        self._write_reference = self._instances.writes(inputs, self._reference)
        self._read_state = self._instances.reads(outputs, self._state)
        self._read_state(0.0)
        self._time = 0.0

    def hold(self, position: Array, velocity: Array) -> None:
        """Take new references (rows, m) from now on."""
        m = position.shape[1]
        self._reference[:, :m] = position
        self._reference[:, m:] = velocity
        self._write_reference(self._time)

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        calls = self._instances.library.calls
        do_step, tail = calls.step, calls.step_tail
        statuses = [do_step(handle, start, step, *tail) for handle in self._instances.handles]
        self._instances.expect(statuses, f"a step of {step:g} s", start)
        self._time = start + step
        self._read_state(self._time)
        self._instances.expect_finite(self._state, self._time)


def _vector(library: Library, name: str, m: int) -> Quantity:
    """Return a quantity that must hold m numbers."""
    quantity = find_quantity(library.archive, name)
    if quantity.size != m:
        raise FmuError(
            f"{library.archive.label}: {name} holds {quantity.size} numbers, expected {m}, one "
            f"for each of the target's axes"
        )
    return quantity


def _told(body: Body, library: Library, names: Mapping[str, str]) -> dict[str, Array]:
    """Return what one robot's FMU is told before its run, by our names of the variables."""
    return {
        **body.parameters,
        "kp": body.kp,
        "kd": body.kd,
        **(_disturbance(body, library, names) if body.disturbance else {}),
        "q": body.q,
        "qd": body.qd,
        "position_ref": body.position,
        "velocity_ref": body.velocity,
    }


def _disturbance(body: Body, library: Library, names: Mapping[str, str]) -> dict[str, Array]:
    """Return the disturbance by our names, its terms padded with zeros to the FMU's number."""
    told = {
        "disturbance_offset": body.disturbance.offset,
        "disturbance_rate": body.disturbance.rate,
    }
    m, p = body.disturbance.amplitude.shape
    for wave in WAVES:
        ours = f"disturbance_{wave}"
        terms = find_quantity(library.archive, names.get(ours, ours)).size // m
        if p > terms:
            raise FmuError(
                f"{library.archive.label}: takes up to {terms} sines and cosines of a disturbance "
                f"on an axis, got {p} for robot {body.robot}"
            )
        told[ours] = np.pad(getattr(body.disturbance, wave), ((0, 0), (0, terms - p)))
    return told
