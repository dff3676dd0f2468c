"""An FMU and the robots that have it become plants: loaded once, instantiated for each robot."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from nrs_cosim.bus.plurals import numbered
from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.archives.archive import Archive, unpacked
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.presence import expect_apart
from nrs_cosim.plant_fmu.archives.quantities import MOTION
from nrs_cosim.plant_fmu.drives import stability
from nrs_cosim.plant_fmu.drives.choice import RTOL, STEP, Driving, Offer, Undriven, choose
from nrs_cosim.plant_fmu.drives.exchange_instance import Exchanged
from nrs_cosim.plant_fmu.drives.model_exchange import ModelExchangePlants
from nrs_cosim.plant_fmu.drives.own_law import without_own_law
from nrs_cosim.plant_fmu.drives.probe import expect_stable, measured_error
from nrs_cosim.plant_fmu.drives.reference_driven import ReferenceDrivenPlants
from nrs_cosim.plant_fmu.drives.runge_kutta import RungeKutta
from nrs_cosim.plant_fmu.drives.stepped import FreePlants
from nrs_cosim.plant_fmu.drives.torque_held import TorqueHeldPlants
from nrs_cosim.plant_fmu.drives.within_efforts import within_efforts
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.fmi.library import Kind, Library
from nrs_cosim.plant_fmu.plants import NOTHING, Array, Body, DrivenPlants

UNDRIVEN_RTOL = 1e-12
"""Of a target, which is run once."""
CVODE = "Model Exchange, CVODE"
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
        library = _loaded(stack, archive, "ModelExchange", load)
        return _by_cvode(library, bodies, names, UNDRIVEN_RTOL, why, free=True)
    if names:
        expect_apart(archive, names, sizes)
    offer = choose(archive, names, driving, sizes)
    asked = driving.solver or driving.control
    why = f"{offer.reason}; " + (
        "the scenario asks for it" if asked else "the FMU offers nothing more accurate"
    )
    _expect_control(archive, offer, bodies)
    library = _loaded(stack, archive, offer.kind, load)
    match offer.way:
        case "reference":
            return ReferenceDrivenPlants(library, bodies, names, why)
        case "cvode":
            return _by_cvode(library, bodies, names, driving.rtol or RTOL, why)
        case "rk4":
            return _by_runge_kutta(library, bodies, names, driving.step or STEP, why)
        case "heun" | "hold":
            step, heun = driving.control_step or STEP, offer.way == "heun"
            return _by_held_torque(library, bodies, representatives, names, step, heun, why)


def _expect_control(archive: Archive, offer: Offer, bodies: Sequence[Body]) -> None:
    """Refuse what the law outside an FMU has not."""
    if offer.way == "reference":
        return
    solved = offer.kind == "ModelExchange"
    for body in bodies:
        wanted = body.control.values().keys() - {"torque_limit"}
        if lacking := sorted(wanted & {"ki"} if solved else wanted):
            raise FmuError(
                f"{archive.label}: {', '.join(lacking)}, as the controller of robot {body.robot} "
                f"wants, is of FMUs that hold the law{'' if solved else ', or of Model Exchange'}; "
                f"this one is driven by {quoted(offer.way)}"
            )


def _loaded(stack: ExitStack, archive: Archive, kind: Kind, load: Load) -> Library:
    folder = stack.enter_context(unpacked(archive))
    return stack.enter_context(load(archive, folder, kind))


def _by_cvode(
    library: Library,
    bodies: Sequence[Body],
    names: Mapping[str, Spec],
    rtol: float,
    why: str,
    *,
    free: bool = False,
) -> DrivenPlants:
    from nrs_cosim.plant_fmu.drives.cvode import Cvode  # noqa: PLC0415, it loads SUNDIALS' libraries

    def solve(robot: Exchanged) -> Cvode:
        solver = Cvode(robot, rtol)
        library.ending.callback(solver.close)
        return solver

    drive = f"{CVODE} rtol {rtol:g}"
    plants = ModelExchangePlants(library, bodies, names, solve, drive=drive, why=why, free=free)
    if states := plants.without_nominal:
        plants.drive += (
            f" (nominal value 1 for {numbered('state', states)}, whose own is not positive)"
        )
    return plants


def _by_runge_kutta(
    library: Library, bodies: Sequence[Body], names: Mapping[str, Spec], step: float, why: str
) -> DrivenPlants:
    def plants(of: Sequence[Body], beside: Mapping[str, Array] = NOTHING) -> ModelExchangePlants:
        drive = f"Model Exchange, RK4 step {step:g} s"
        return ModelExchangePlants(
            library,
            of,
            names,
            lambda robot: RungeKutta(robot, step),
            drive=drive,
            why=why,
            beside=beside,
        )

    pushed = plants(bodies[:1], without_own_law(library.archive, names, bodies[0]))
    expect_stable(pushed, bodies, stability.runge_kutta, "step", step)
    return plants(bodies)


def _by_held_torque(
    library: Library,
    bodies: Sequence[Body],
    representatives: Sequence[Body],
    names: Mapping[str, Spec],
    step: float,
    heun: bool,
    why: str,
) -> DrivenPlants:
    def probe(control_step: float, beside: Mapping[str, Array] = NOTHING) -> TorqueHeldPlants:
        return TorqueHeldPlants(library, bodies[:1], names, control_step, heun=heun, beside=beside)

    pushed = probe(step, without_own_law(library.archive, names, bodies[0]))
    propagate = stability.heun if heun else stability.held
    expect_stable(pushed, bodies, propagate, "control_step", step)
    # By Richardson: of an error of order p, halving the step takes away 1 − 2⁻ᵖ.
    error = measured_error(probe(step), probe(step / 2), representatives or bodies, step)
    how = "corrected and held" if heun else "held"
    accuracy = "error not measured: nothing moves at the start"
    if error is not None:
        accuracy = f"error about {error * (4 / 3 if heun else 2):.1g} rad"
    drive = f"torque {how} for {step:g} s ({accuracy})"
    return TorqueHeldPlants(library, bodies, names, step, heun=heun, drive=drive, why=why)
