"""What a plant tells when it is tried out beside the run: M⁻¹ by small pushes, errors by halving.

A push e_j from rest changes q̇ by M⁻¹ e_j T over a short T, beside what gravity does to it.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Protocol

import numpy as np

from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.drives.stability import Propagate, step_limit
from nrs_cosim.plant_fmu.errors import FmuError, StepError, UnstableStepError, before_run
from nrs_cosim.plant_fmu.plants import PD_ALONE, Array, Body, Disturbance, Plants

POSTURES = 16
SEED = 2003
"""One for all that is drawn: an FMU is always probed at the same postures."""
PATIENCE = 1.0
"""s, after which a push is taken to move nothing."""
SPAN, ROBOTS = 0.2, 8
"""s: the beginning over which an error is measured, and of how many robots."""
MOVED = 1e-9
"""rad: what moves by less only rounds, and shows neither an error nor that it is well."""


class Probe(Plants, Protocol):
    """One plant that can be started anew as often as one likes."""

    def start_again(self, bodies: Sequence[Body]) -> None:
        """Return to t_0 with another body."""


@contextmanager
def trying(doing: str) -> Iterator[None]:
    """Make a failed step of a trial bad input, which says that it was before the run.

    An instance is tried for several robots under the name of the first: which it was is said too.
    """
    try:
        yield
    except StepError as error:
        raise FmuError(f"{error}{before_run(doing)}") from None


def expect_stable(
    probe: Probe, bodies: Sequence[Body], propagate: Propagate, name: str, step: float
) -> None:
    """Raise `UnstableStepError` where a step is beyond the limit estimated for a robot."""
    for body in _distinct(bodies):
        with trying(f"the stability of its step was estimated for robot {body.robot}"):
            held = _moving_span(probe, body, step)
            scaled = body.control.inertia_scaling or body.control.computed_torque
            gains = [body.kp, body.kd]
            if "ki" in body.control.wanted():
                gains.append(body.control.values()["ki"])
            limit = min(
                step_limit(inverse @ np.hstack(gains), propagate)
                for inverse in (
                    [np.eye(len(body.q))] if scaled else _inverse_inertias(probe, body, step, held)
                )
            )
        if held > limit:
            moves = f", since it moves only every {held:g} s" if held > step else ""
            raise UnstableStepError(
                f"{name} = {step:g} s is beyond the stability limit of about {limit:.2g} s "
                f"estimated for robot {body.robot}{moves}: its motion would diverge; take "
                f"{'' if held > step else f'a smaller {name}, or '}lower gains"
            )


def measured_error(coarse: Probe, fine: Probe, bodies: Sequence[Body], step: float) -> float | None:
    """Return the most that q, in rad, differs between two probes at some robots' beginning.

    None where nothing moves there: a robot at rest at its reference tells of no error.
    """
    error = moved = 0.0
    for body in bodies[:ROBOTS]:
        with trying(f"the error of a held torque was measured for robot {body.robot}"):
            for probe in (coarse, fine):
                probe.start_again([body])
                probe.hold(body.position[None], body.velocity[None])
            for j in range(parts(SPAN, step)):
                for probe in (coarse, fine):
                    probe.advance(j * step, step)
                error = max(error, float(np.abs(coarse.q - fine.q).max()))
                moved = max(moved, float(np.abs(fine.q - body.q).max()))
    return error if moved > MOVED else None


def under_torque(body: Body, q: Array, qd: Array, tau: Array) -> Body:
    """Return a robot that starts at q and q̇ under a constant torque alone, all (m,)."""
    m = len(q)
    none, torque = np.zeros((m, m)), Disturbance(tau, np.zeros(m), *np.zeros((3, m, 0)))
    return replace(body, q=q, qd=qd, kp=none, kd=none, disturbance=torque, control=PD_ALONE)


def _moving_span(probe: Probe, body: Body, step: float) -> float:
    """Return after how many s a push has moved each joint: a step, or more of a plant's own.

    Where nothing moves within `PATIENCE` there is nothing to be estimated.
    """
    span = step
    while span <= PATIENCE:
        if inverse_inertia(probe, body, body.q, step, span).any(axis=0).all():
            return span
        span *= 2
    return step


def _inverse_inertias(probe: Probe, body: Body, step: float, span: float) -> Iterator[Array]:
    """Yield M⁻¹ at a robot's initial posture, and at some that are drawn and not refused."""
    m = len(body.q)
    yield inverse_inertia(probe, body, body.q, step, span)
    for q in np.random.Generator(np.random.Philox(SEED)).uniform(-np.pi, np.pi, (POSTURES, m)):
        with suppress(FmuError, StepError):
            yield inverse_inertia(probe, body, q, step, span)


def inverse_inertia(probe: Probe, body: Body, q: Array, step: float, span: float) -> Array:
    """Return M⁻¹(q), (m, m), of pushes for a span of steps in s, beside what gravity does."""
    rest = _pushed(probe, body, q, np.zeros(len(q)), step, span)
    pushes = np.eye(len(q))
    pushed = [_pushed(probe, body, q, push, step, span) for push in pushes]
    inverse: Array = (np.array(pushed) - rest).T / span
    return inverse


def _pushed(probe: Probe, body: Body, q: Array, push: Array, step: float, span: float) -> Array:
    """Return q̇ after a span of steps from rest under a constant torque alone."""
    probe.start_again([under_torque(body, q, np.zeros(len(q)), push)])
    for j in range(round(span / step)):
        probe.advance(j * step, step)
    qd: Array = probe.qd[0].copy()
    return qd


def _distinct(bodies: Sequence[Body]) -> list[Body]:
    """Return the first robot of each set of parameters, gains and what the law has beside them."""
    first: dict[tuple[str, ...], Body] = {}
    for body in bodies:
        given = body.parameters, {"kp": body.kp, "kd": body.kd, **body.control.values()}
        key = tuple(
            repr([(k, np.asarray(v).tolist()) for k, v in sorted(d.items())]) for d in given
        )
        first.setdefault(key, body)
    return list(first.values())
