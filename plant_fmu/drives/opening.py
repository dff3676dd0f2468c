"""An FMU and the robots that have it become plants: loaded once, instantiated for each robot."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.archives.archive import Archive, unpacked
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.presence import expect_apart
from nrs_cosim.plant_fmu.archives.quantities import MOTION
from nrs_cosim.plant_fmu.drives.choice import (
    RTOL,
    STEP,
    Driving,
    Offer,
    Undriven,
    choose,
    offers,
)
from nrs_cosim.plant_fmu.drives.reference_driven import ReferenceDrivenPlants
from nrs_cosim.plant_fmu.drives.stepped import FreePlants
from nrs_cosim.plant_fmu.drives.within_efforts import within_efforts
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.fmi.library import Kind, Library
from nrs_cosim.plant_fmu.plants import Body, DrivenPlants

UNDRIVEN_RTOL = 1e-12
"""Of a target, which is run once."""
_ANY = Driving()

Load = Callable[[Archive, Path, Kind], Library]
"""Loads an unpacked archive for one of its kinds."""


def open_plants(
    stack: ExitStack,
    archive: Archive,
    bodies: Sequence[Body],
    names: Mapping[str, Spec],
    driving: Driving | Undriven = _ANY,
    load: Load = Library,
    representatives: Sequence[Body] = (),
) -> DrivenPlants:
    """Return the bodies' plants at t_0, in the bodies' order; the stack ends them.

    What is told of an error is measured at the `representatives` of all robots that have such a
    plant, wherever they are; at these bodies without any.
    `names` gives what a quantity of ours is in the FMU where it is not found by our name.
    `FmuError` says what is wrong with the FMU or with what it was told.
    """
    sizes = sizes_of(assignments(archive, bodies[0].parameters))
    bodies, representatives = (within_efforts(archive, some) for some in (bodies, representatives))
    if isinstance(driving, Undriven):
        expect_apart(archive, names, sizes, MOTION)
        why = "it moves by itself"
        if "CoSimulation" in archive.kinds:
            return FreePlants(_loaded(stack, archive, "CoSimulation", load), bodies, names, why)
        if archive.clocks:
            raise FmuError(f"{archive.label}: cannot be run{archive.needs}")
        from nrs_cosim.plant_fmu.drives import law_outside  # noqa: PLC0415, as below

        library = _loaded(stack, archive, "ModelExchange", load)
        return law_outside.by_cvode(library, bodies, names, UNDRIVEN_RTOL, why, free=True)
    if names:
        expect_apart(archive, names, sizes)
    offer = choose(archive, names, driving, sizes)
    asked = driving.solver or driving.control
    why = f"{offer.reason}; " + (
        "the scenario asks for it" if asked else "the FMU offers nothing more accurate"
    )
    if offer.way in {"heun", "hold"}:
        others = {other.kind for other in offers(archive, names, sizes)} - {"CoSimulation"}
        _expect_limits_alone(archive, offer, bodies, has_equations=bool(others))
    library = _loaded(stack, archive, offer.kind, load)
    if offer.way == "reference":
        return ReferenceDrivenPlants(library, bodies, names, why)
    from nrs_cosim.plant_fmu.drives import law_outside  # noqa: PLC0415, of these ways alone

    match offer.way:
        case "cvode":
            return law_outside.by_cvode(library, bodies, names, driving.rtol or RTOL, why)
        case "rk4":
            return law_outside.by_runge_kutta(library, bodies, names, driving.step or STEP, why)
        case way:
            step = driving.control_step or STEP
            return law_outside.by_held_torque(
                library, bodies, representatives, names, step, way == "heun", why
            )


def _expect_limits_alone(
    archive: Archive, offer: Offer, bodies: Sequence[Body], *, has_equations: bool
) -> None:
    """Refuse what a law has not whose torque is held."""
    for body in bodies:
        if lacking := sorted(body.control.wanted() - {"torque_limit"}):
            raise FmuError(
                f"{archive.label}: {', '.join(lacking)}, as the controller of robot {body.robot} "
                f"wants, is of FMUs that hold the law, or of Model Exchange; this one is driven by "
                f"{quoted(offer.way)}, a torque that is held: "
                + (
                    'leave plant.control away, or take plant.solver = "cvode"'
                    if has_equations
                    else "export it for Model Exchange, or leave that out of the controller"
                )
            )


def _loaded(stack: ExitStack, archive: Archive, kind: Kind, load: Load) -> Library:
    folder = stack.enter_context(unpacked(archive))
    return stack.enter_context(load(archive, folder, kind))
