"""Before a run: what the theory says of a scenario (paper, Theorems 1 and 3)."""

from dataclasses import asdict, dataclass
from math import isfinite
from typing import Any

import numpy as np

from estimator_agents.algorithm import load_algorithm
from estimator_agents.condition import Condition
from estimator_agents.theory.spectrum import smallest_theta, spectral_radius, spectrum_of
from orchestrator.scenario import Scenario
from orchestrator.setting import gain, topology_of


@dataclass(frozen=True, slots=True)
class Check:
    """The theory's verdict on a scenario."""

    algorithm: str
    spectrum: list[tuple[float, float]]
    """Eigenvalues of D, (real, imaginary), by real then imaginary part."""
    spectral_radius: float
    """ρ of the estimation error's recursion: it converges if and only if ρ < 1."""
    alpha_beta_bound: float
    """min θ_i, in s⁰: what Theorem 1 bounds α and β by, and Theorem 3 β."""
    h_bound: float | None
    """What Theorem 3 bounds the sampling period by, s; None for an algorithm that has no such."""
    spanning_tree: bool
    """Assumption A2: a directed path leads from the target to every robot."""
    conditions: tuple[Condition, ...]

    def as_json(self) -> dict[str, Any]:
        """Return the verdict for JSON, with each condition's margin and whether it holds."""
        conditions = [
            {
                "name": condition.name,
                "source": condition.source,
                "left": _finite(condition.left),
                "right": _finite(condition.right),
                "margin": _finite(condition.margin),
                "holds": condition.holds,
            }
            for condition in self.conditions
        ]
        return {**asdict(self), "h_bound": _finite(self.h_bound), "conditions": conditions}

    def warnings(self) -> list[str]:
        """Return one line for each condition that does not hold, and one if the error grows."""
        unmet = [_warning(condition) for condition in self.conditions if not condition.holds]
        if self.spectral_radius >= 1:
            unmet.append(
                f"the estimates diverge: their error grows by a factor of "
                f"{self.spectral_radius:.6f} at each sampling time"
            )
        return unmet


def check(scenario: Scenario) -> Check:
    """Return what the theory says of a scenario."""
    topology = topology_of(scenario)
    choice, h = scenario.algorithm, scenario.run.sampling_period
    algorithm = load_algorithm(choice.name, choice.alpha, choice.beta)
    spectrum = spectrum_of(topology)
    conditions = (*algorithm.conditions(spectrum, h), *_gain_conditions(scenario))
    periods = [c.right for c in conditions if c.name == "sampling_period"]
    return Check(
        algorithm=choice.name,
        spectrum=[(float(s.real), float(s.imag)) for s in np.sort_complex(spectrum)],
        spectral_radius=spectral_radius(algorithm.modes(spectrum, h)),
        alpha_beta_bound=smallest_theta(spectrum),
        h_bound=min(periods, default=None),
        spanning_tree=not topology.unreached(),
        conditions=conditions,
    )


def _finite(number: float | None) -> float | None:
    """JSON has no infinity: a bound that no number reaches is null."""
    return number if number is not None and isfinite(number) else None


def _gain_conditions(scenario: Scenario) -> list[Condition]:
    """Return that all robots' PD gains are positive definite: 0 < min x'Kx over |x| = 1."""
    controllers = [scenario.controller, *(r.controller for r in scenario.robots if r.controller)]
    conditions = []
    for name in ("kp", "kd"):
        gains = [gain(getattr(controller, name), scenario.m) for controller in controllers]
        smallest = min(float(np.linalg.eigvalsh((K + K.T) / 2)[0]) for K in gains)
        conditions.append(Condition(name, "positive definite", 0.0, smallest))
    return conditions


def _warning(condition: Condition) -> str:
    if condition.source == "positive definite":
        return f"{condition.name} is not positive definite: an eigenvalue is {condition.right:g}"
    return (
        f"{condition.name} = {condition.left:g} is outside (0, {condition.right:.6g}), "
        f"the bound of {condition.source}"
    )
