"""Ways of driving a plant, the most accurate first: what an FMU offers, and what is taken.

1. reference: Co-Simulation with the PD law in the FMU
2. cvode:     Model Exchange with the law in the right-hand side, an adaptive solver
3. rk4:       the same, with equal steps
4. heun:      Co-Simulation with a torque from outside, corrected once
5. hold:      Co-Simulation with a torque from outside
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.presence import has, takes, why_not
from nrs_cosim.plant_fmu.archives.variables import NO_SIZES
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.library import Kind

Way = Literal["reference", "cvode", "rk4", "heun", "hold"]

CVODE = "Model Exchange, CVODE"
"""How a drive by it is told."""
RTOL = 1e-9
STEP = 0.005
"""s"""


@dataclass(frozen=True, slots=True)
class Driving:
    """How a scenario wants a plant to be driven; None leaves the choice to what the FMU offers."""

    solver: Literal["cvode", "rk4"] | None = None
    """Of Model Exchange."""
    rtol: float | None = None
    """Of cvode; `RTOL` by default."""
    step: float | None = None
    """s: the longest of rk4; `STEP` by default."""
    control: Literal["hold", "heun"] | None = None
    """Of a torque from outside, in Co-Simulation."""
    control_step: float | None = None
    """s: the longest for which a torque is held; `STEP` by default."""
    threads: bool = False
    """Whether several threads may step a third-party FMU."""
    uneven: bool = False
    """Whether steps are of many lengths, which an FMU in Co-Simulation may not be able to take."""

    @classmethod
    def of(cls, plant: Any, *, uneven: bool = False) -> "Driving":
        """Return it of a plant's table, which has the other keys."""
        keys = {key.name for key in fields(cls)} - {"uneven"}
        return cls(**{key: getattr(plant, key) for key in keys}, uneven=uneven)


@dataclass(frozen=True, slots=True)
class Undriven:
    """Not at all: a target, which moves by itself."""


@dataclass(frozen=True, slots=True)
class Offer:
    """A way of driving that an FMU offers."""

    way: Way
    kind: Kind
    reason: str
    """What it rests on, and how accurate that is."""


_OPTIONS: dict[Way, str] = {"cvode": "rtol", "rk4": "step", "heun": "control_step"}
_OPTIONS["hold"] = "control_step"


def offers(
    archive: Archive, names: Mapping[str, Spec], sizes: Mapping[int, int] = NO_SIZES
) -> tuple[Offer, ...]:
    """Return the ways that an FMU offers, the most accurate first."""
    description = archive.description
    has_state = has(archive, names, "q", "qd", sizes=sizes)
    torque = has_state and takes(archive, names, "tau", sizes=sizes)
    steps, equations = description.coSimulation, description.modelExchange
    offered: list[Offer] = []
    references = takes(archive, names, "position_ref", "velocity_ref", sizes=sizes)
    if steps and has_state and references:
        reason = "it takes references and holds the PD law: exact to its own tolerance"
        offered.append(Offer("reference", "CoSimulation", reason))
    if equations and not archive.clocks and torque and description.numberOfContinuousStates:
        reason = (
            "it takes tau, so that the PD law is in the right-hand side: exact to the solver's "
        )
        offered.append(Offer("cvode", "ModelExchange", f"{reason}tolerance"))
        offered.append(Offer("rk4", "ModelExchange", f"{reason}step, of order 4"))
    if steps and torque:
        if steps.canGetAndSetFMUstate:
            reason = "it takes tau and can go back: a torque corrected once, of order 2 in its step"
            offered.append(Offer("heun", "CoSimulation", reason))
        reason = "it takes tau: a held torque, of order 1 in its step"
        offered.append(Offer("hold", "CoSimulation", reason))
    return tuple(offered)


def choose(
    archive: Archive,
    names: Mapping[str, Spec],
    driving: Driving,
    sizes: Mapping[int, int] = NO_SIZES,
) -> Offer:
    """Return the way that a scenario asks for, or the most accurate that an FMU offers.

    `FmuError` says what the FMU offers and lacks, or which option has no use.
    """
    if driving.solver and driving.control:
        raise FmuError(
            f"{archive.label}: plant.solver = {quoted(driving.solver)} and plant.control = "
            f"{quoted(driving.control)} exclude each other: one is of Model Exchange, the other of "
            f"Co-Simulation"
        )
    offered = offers(archive, names, sizes)
    if driving.uneven and not archive.takes_uneven_steps:
        offered = tuple(offer for offer in offered if offer.kind != "CoSimulation")
    asked = driving.solver or driving.control
    fitting = [offer for offer in offered if asked in {None, offer.way}]
    if not fitting:
        refusal = _refusal(archive, names, offered, driving, sizes)
        raise FmuError(f"{archive.label}: {refusal}")
    _expect_use(archive, fitting[0], driving)
    return fitting[0]


def _refusal(
    archive: Archive,
    names: Mapping[str, Spec],
    offered: tuple[Offer, ...],
    driving: Driving,
    sizes: Mapping[int, int],
) -> str:
    """Say what an FMU offers, and what it would have to have for more."""
    asked = driving.solver or driving.control
    ways = ", ".join(offer.way for offer in offered) or "none"
    wanted = f"cannot be driven by {quoted(asked)}" if asked else "cannot be driven"
    lacking = [
        f"{name} (an input)"
        for name in ("tau", "position_ref", "velocity_ref")
        if not takes(archive, names, name, sizes=sizes)
    ]
    lacking += [name for name in ("q", "qd") if not has(archive, names, name, sizes=sizes)]
    lacking += sorted({"CoSimulation", "ModelExchange"}.difference(archive.kinds))
    if archive.clocks:
        lacking.append(f"an environment that ticks its clocks {', '.join(archive.clocks)}")
    description = archive.description.coSimulation
    if description and not description.canGetAndSetFMUstate:
        lacking.append("canGetAndSetFMUState")
    if driving.uneven and not archive.takes_uneven_steps:
        lacking.append("canHandleVariableCommunicationStepSize, for sampling times are aperiodic")
    causes = [why_not(archive, names, name, sizes) for name in ("q", "qd", "tau")]
    cause = next(filter(None, causes), "")
    return f"{wanted}; the ways that it offers are {ways}, and it lacks {', '.join(lacking)}" + (
        f". First: {cause}" if cause else ""
    )


def _expect_use(archive: Archive, offer: Offer, driving: Driving) -> None:
    """Refuse an option that the chosen way has no use for."""
    if driving.threads and offer.kind == "ModelExchange":
        raise FmuError(
            f"{archive.label}: plant.threads = true has no use, for the FMU is driven by "
            f"{quoted(offer.way)}, whose steps are made by one thread"
        )
    for option in ("rtol", "step", "control_step"):
        value = getattr(driving, option)
        if value is not None and option != _OPTIONS.get(offer.way):
            ways = [repr(way) for way, its in _OPTIONS.items() if its == option]
            raise FmuError(
                f"{archive.label}: plant.{option} = {value:g} has no use, for the FMU is driven "
                f"by {quoted(offer.way)}; it is of {' and '.join(ways)}"
            )
