"""A plant whose law is not in its FMU: in the right-hand side of Model Exchange, or a held torque.

By a solver a target is moved too, which has no law. Apart from `opening`, since an FMU that holds
the law, as bundled models do, needs nothing of it.
"""

from collections.abc import Mapping, Sequence

from nrs_cosim.bus.plurals import numbered
from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives import stability
from nrs_cosim.plant_fmu.drives.choice import CVODE
from nrs_cosim.plant_fmu.drives.exchange_instance import Exchanged
from nrs_cosim.plant_fmu.drives.model_exchange import ModelExchangePlants
from nrs_cosim.plant_fmu.drives.own_law import without_own_law
from nrs_cosim.plant_fmu.drives.probe import Probe, expect_stable, measured_error
from nrs_cosim.plant_fmu.drives.rate import NOT_THE_RATE, other_rate_at_start
from nrs_cosim.plant_fmu.drives.runge_kutta import RungeKutta
from nrs_cosim.plant_fmu.drives.torque_held import TorqueHeldPlants
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.plants import NOTHING, Array, Body, DrivenPlants


def by_cvode(
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


def by_runge_kutta(
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
    driven = plants(bodies)
    driven.drive += _of_rate(library.archive, pushed, bodies[0], step)
    return driven


def by_held_torque(
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
    accuracy = (
        "error not measured: nothing moves at the start; --set initial.q=0.1 measures it there"
    )
    if error is not None:
        accuracy = f"error about {error * (4 / 3 if heun else 2):.1g} rad"
    rate = _of_rate(library.archive, pushed, (representatives or bodies)[0], step)
    drive = f"torque {how} for {step:g} s ({accuracy}){rate}"
    return TorqueHeldPlants(library, bodies, names, step, heun=heun, drive=drive, why=why)


def _of_rate(archive: Archive, probe: Probe, body: Body, step: float) -> str:
    """Return what is told beside how an FMU of others is driven, whose q̇ is not the rate of q."""
    other = "" if archive.ours else other_rate_at_start(probe, body, step)
    return f"; {NOT_THE_RATE}: {other}" if other else ""
