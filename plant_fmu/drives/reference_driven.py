"""The FMU holds the PD loop: one doStep an interval, exact to the FMU's own tolerance.

Its inputs are ε(t_k⁺) and υ(t_k⁺), and it extrapolates the reference itself.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.presence import has
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.plants import Array, Body

REFERENCE = ("position_ref", "velocity_ref")
GAINS = ("kp", "kd")
WAVES = ("amplitude", "frequency", "phase")
DISTURBANCE = tuple(f"disturbance_{part}" for part in ("offset", "rate", *WAVES))


class ReferenceDrivenPlants:
    """Plants driven by `position_ref` and `velocity_ref`; see `plant_fmu.plants.DrivenPlants`.

    An FMU that does not tell its `tau_applied` is taken to apply `plant_fmu.drives.pd_law`.
    """

    kind = "CoSimulation"
    drive = "reference-driven Co-Simulation"

    def __init__(
        self, library: Library, bodies: Sequence[Body], names: Mapping[str, Spec], why: str
    ) -> None:
        """Instantiate and initialise one plant for each body; `FmuError` says what is wrong.

        `names` gives the FMU's name for a quantity of ours where it has another.
        """
        self.why, archive = why, library.archive
        self._tells_torque = has(archive, names, "tau_applied")
        outputs = ("q", "qd", "tau_applied") if self._tells_torque else ("q", "qd")
        self._stepped = Stepped(
            library, bodies, names, lambda body: _start_values(body, archive, names), outputs
        )
        self.checkpointable = self._stepped.checkpointable
        m, state = self._stepped.m, self._stepped.outputs
        self._reference, self._write_reference = self._stepped.inputs(*REFERENCE)
        self.q, self.qd = state[:, :m], state[:, m : 2 * m]
        self.tau = state[:, 2 * m :] if self._tells_torque else np.empty((len(bodies), m))
        self._tell_torque()

    def hold(self, position: Array, velocity: Array) -> None:
        """Take new references (rows, m) from now on."""
        m, now = position.shape[1], self._stepped.time
        # The law has them too, for a checkpoint, and for the torque where the FMU tells none.
        self._stepped.law.hold(now, position, velocity)
        self._reference[:, :m] = position
        self._reference[:, m:] = velocity
        self._write_reference(now)

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        self._stepped.step(start, step)
        self._tell_torque()

    def save(self) -> list[bytes]:
        """Return each robot's checkpoint."""
        return self._stepped.save()

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned."""
        self._stepped.restore(data)
        self._tell_torque()

    def _tell_torque(self) -> None:
        if not self._tells_torque:
            stepped = self._stepped
            self.tau[:] = stepped.law.torque(stepped.time, stepped.state)


def _start_values(body: Body, archive: Archive, names: Mapping[str, Spec]) -> dict[str, Array]:
    """Return what one robot's FMU is told before its run, by our names of the variables."""
    gains = {gain: getattr(body, gain) for gain in GAINS if has(archive, names, gain)}
    return {
        **gains,
        **(_disturbance(body, archive, names) if body.disturbance else {}),
        "q": body.q,
        "qd": body.qd,
        "position_ref": body.position,
        "velocity_ref": body.velocity,
    }


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
