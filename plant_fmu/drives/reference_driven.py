"""The FMU holds the PD loop: one doStep an interval, exact to the FMU's own tolerance.

Its inputs are ε(t_k⁺) and υ(t_k⁺), and it extrapolates the reference itself: since the time in its
input `reference_time`, or, where it has none, since it was last given one. So it does with an
acceleration, where it has an input for it. Where it has none, a reference ε + s υ + s²/2 a is given
as its chord over each step: off by a step²/8 in position and by a step/2 in velocity.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.presence import has, takes
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.fmi.instances import NativeSteps
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.plants import Array, Body

REFERENCE = ("position_ref", "velocity_ref")
ACCELERATION = "acceleration_ref"
TIME = "reference_time"
GAINS = ("kp", "kd")
WAVES = ("amplitude", "frequency", "phase")
DISTURBANCE = tuple(f"disturbance_{part}" for part in ("offset", "rate", *WAVES))


class ReferenceDrivenPlants(Stepped):
    """Plants driven by `position_ref` and `velocity_ref`; see `plant_fmu.plants.DrivenPlants`.

    An acceleration is given to those that take `acceleration_ref`; with the others see the module.
    An FMU that does not tell its `tau_applied` is taken to apply `plant_fmu.drives.pd_law` of PD
    within limits, and may have no more.
    """

    drive = "reference-driven Co-Simulation"

    def __init__(
        self, library: Library, bodies: Sequence[Body], names: Mapping[str, Spec], why: str
    ) -> None:
        archive = library.archive
        self._tells_torque = has(archive, names, "tau_applied")
        outputs = ("q", "qd", "tau_applied") if self._tells_torque else ("q", "qd")
        super().__init__(
            library, bodies, names, lambda body: start_values(body, archive, names), outputs, why
        )
        sizes = dict.fromkeys(REFERENCE, self.m)
        if takes(archive, names, TIME):
            sizes[TIME] = 1
        self._sizes = sizes
        self._reference, self._write_reference = self._inputs(sizes)
        self._acceleration: Array | None = None
        if takes(archive, names, ACCELERATION):
            self._acceleration, self._write_acceleration = self._inputs({ACCELERATION: self.m})
        self._curve: tuple[float, Array] | None = None
        """What is given in chords: since when, s, and what reference, (3, rows, m)."""
        if self._tells_torque:
            self.tau = self.outputs[:, 2 * self.m :]

    def hold(self, *reference: Array) -> None:
        """Take new references (rows, m) from now on."""
        if len(reference) == len(REFERENCE) or self._acceleration is not None:
            self._curve = None
            self._give(*reference)
        else:
            self._curve = self.time, np.array(reference)

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        if self._curve:
            since, (position, velocity, acceleration) = self._curve
            begin, end = (
                position + s * (velocity + s / 2 * acceleration)
                for s in (start - since, start + step - since)
            )
            self._give(begin, (end - begin) / step)
        super().advance(start, step)

    def native(self) -> NativeSteps | str:
        """Return by what native code gives them lines to follow and steps them, or why not."""
        if not self._tells_torque:
            return "an FMU does not tell its torque"
        if self._acceleration is not None and self._acceleration.any():
            return "references are accelerated"
        given = [self.instances.vector(*one) for one in self._sizes.items()]
        return self.instances.native((given, self._reference), (self._told_by, self.outputs))

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned; only where it is `checkpointable`."""
        super().restore(data)
        self._curve = None
        if self._acceleration is not None:
            self._acceleration[:] = self.law.reference[:, 2 * self.m :]

    def _give(self, position: Array, velocity: Array, acceleration: Array | None = None) -> None:
        # The law has them too, for a checkpoint, and for the torque where the FMU tells none.
        self.law.hold(self.time, position, velocity, acceleration)
        self._reference[:, : self.m] = position
        self._reference[:, self.m : 2 * self.m] = velocity
        self._reference[:, 2 * self.m :] = self.time
        self._write_reference(self.time)
        given = self._acceleration
        if given is not None and (acceleration is not None or given.any()):
            given[:] = 0.0 if acceleration is None else acceleration
            self._write_acceleration(self.time)

    def _tell_torque(self) -> None:
        if not self._tells_torque:
            super()._tell_torque()


def start_values(body: Body, archive: Archive, names: Mapping[str, Spec]) -> dict[str, Array]:
    """Return what one robot's FMU is told before its run, by our names: of any shape (…)."""
    gains = {gain: getattr(body, gain) for gain in GAINS if has(archive, names, gain)}
    return {
        **gains,
        **_control(body, archive, names),
        **(_disturbance(body, archive, names) if body.disturbance else {}),
        "q": body.q,
        "qd": body.qd,
        "position_ref": body.position,
        "velocity_ref": body.velocity,
        **({ACCELERATION: np.zeros(len(body.q))} if takes(archive, names, ACCELERATION) else {}),
        **({TIME: np.zeros(1)} if takes(archive, names, TIME) else {}),
    }


def _control(body: Body, archive: Archive, names: Mapping[str, Spec]) -> dict[str, Array]:
    """Return what the law has beside its gains, by our names."""
    values, wanted = body.control.values(), body.control.wanted()
    known = {name: value for name, value in values.items() if has(archive, names, name)}
    more, lacking = sorted(wanted - {"torque_limit"}), sorted(wanted - known.keys())
    if lacking:
        fault = f"which has no variable {', '.join(lacking)}"
    elif more and not has(archive, names, "tau_applied"):
        fault = f"which tells no tau_applied: torques could not be recorded with {', '.join(more)}"
    else:
        return known
    outside = "ModelExchange" in archive.kinds and takes(archive, names, "tau")
    raise FmuError(
        f"{archive.label}: holds a law of its own, {fault}, as the controller of robot "
        f"{body.robot} wants; "
        + ('with plant.solver = "cvode" the law is outside of it, or ' if outside else "")
        + "plant.variables says where it has other names"
    )


def _disturbance(body: Body, archive: Archive, names: Mapping[str, Spec]) -> dict[str, Array]:
    """Return the disturbance by our names, its terms padded with zeros to the FMU's number."""
    lacking = [name for name in DISTURBANCE if not has(archive, names, name)]
    if lacking:
        raise FmuError(
            f"{archive.label}: cannot take the disturbance of robot {body.robot}: driven by "
            f"references, it has no variable {', '.join(lacking)}"
        )
    values = {
        "disturbance_offset": body.disturbance.offset,
        "disturbance_rate": body.disturbance.rate,
    }
    m, p = body.disturbance.amplitude.shape
    sizes = sizes_of(assignments(archive, body.parameters))
    for wave in WAVES:
        ours = f"disturbance_{wave}"
        terms = find_quantity(archive, ours, names, sizes=sizes).size // m
        if p > terms:
            raise FmuError(
                f"{archive.label}: takes up to {terms} sines and cosines of a disturbance "
                f"on an axis, got {p} for robot {body.robot}"
            )
        values[ours] = np.zeros((m, terms))
        values[ours][:, :p] = getattr(body.disturbance, wave)
    return values
