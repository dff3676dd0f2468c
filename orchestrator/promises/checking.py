"""Before a run: whether the theory lets its estimates settle (paper, Theorems 1 and 3)."""

from dataclasses import asdict, dataclass
from math import inf, isfinite, log
from typing import Any

import numpy as np

from estimator_agents.algorithm import demands, load_algorithm
from estimator_agents.condition import Condition
from estimator_agents.theory.aperiodic import Growth, Periods
from estimator_agents.theory.network import Network, network_of
from estimator_agents.theory.spectrum import smallest_theta, spectrum_of
from estimator_agents.theory.tracking import TRACKING
from orchestrator.promises.bounding import Find, tracking_conditions
from orchestrator.promises.settling import growth_of, periods_of
from orchestrator.scenario.setting import gain, target_of, topologies_of
from orchestrator.scenario.tables import Scenario

OF_PERIOD = "sampling_period"
"""The conditions of this name are on a period that is always the same."""


@dataclass(frozen=True, slots=True)
class Check:
    """The theory's verdict on a scenario."""

    algorithm: str
    spectrum: list[tuple[float, float]]
    """Eigenvalues of D, (real, imaginary), by real then imaginary part."""
    growth: Growth
    """Of the estimation error."""
    alpha_beta_bound: float
    """min θ_i, in s⁰: what Theorem 1 bounds α and β by, and Theorem 3 β."""
    h_bound: float | None
    """What Theorem 3 bounds a constant period by, s; None for an algorithm that has no such."""
    spanning_tree: bool
    """Assumption A2: a directed path leads from the target to every robot."""
    conditions: tuple[Condition, ...]
    network: Network
    periods: Periods

    @property
    def spectral_radius(self) -> float:
        """ρ of the estimation error's recursion: it converges if and only if ρ < 1."""
        return self.growth.factor

    @property
    def whole_spectrum(self) -> bool:
        """Whether all eigenvalues of D are there; of very large digraphs the outermost may be."""
        return len(self.spectrum) == sum(map(len, self.network.components))

    @property
    def rate(self) -> float:
        """−ln ρ / h, per s: in the long run an error falls as e^(−rate t)."""
        radius = self.spectral_radius
        return -log(radius) / self.periods.mean if radius > 0 else inf if radius == 0 else radius

    @property
    def settling(self) -> float:
        """s, in the long run, until an error is a millionth of itself; infinite if it grows."""
        return log(1e6) / self.rate if self.rate > 0 else inf

    def as_json(self) -> dict[str, Any]:
        """Return the verdict for JSON, with each condition's margin and whether it holds."""
        conditions = [
            {
                "name": condition.name,
                "source": condition.source,
                "left": finite(condition.left),
                "right": finite(condition.right),
                "margin": finite(condition.margin),
                "holds": condition.holds,
                "sampled": condition.sampled,
            }
            for condition in self.conditions
        ]
        told = asdict(self)
        growth, periods = told.pop("growth"), self.periods
        del told["periods"]
        aperiodic = {
            "shortest": periods.shortest,
            "longest": periods.longest,
            "lower": finite(growth["lower"]),
            "upper": finite(growth["upper"]),
            "verdict": self.growth.verdict,
        }
        return {
            **told,
            "spectral_radius": finite(self.spectral_radius),
            "alpha_beta_bound": finite(self.alpha_beta_bound),
            "h_bound": finite(self.h_bound),
            "conditions": conditions,
            "period": periods.mean,
            "whole_spectrum": self.whole_spectrum,
            "rate": finite(self.rate),
            "settling": finite(self.settling),
            **({"aperiodic": aperiodic} if periods.alike is None else {}),
        }

    def warnings(self) -> list[str]:
        """Return one line for each condition that does not hold, and one if the error grows."""
        unmet = [
            _warning(condition)
            for condition in self.conditions
            if not condition.holds and condition.source != TRACKING
        ]
        if self.spectral_radius >= 1:
            unmet.append(
                f"the estimates diverge: their error grows by a factor of "
                f"{self.spectral_radius:.6f} at each sampling time"
            )
        elif self.growth.lower >= 1:
            unmet.append(
                f"some jitter lets the estimates diverge: their error grows by a factor of "
                f"{self.growth.lower:.6f} at each sampling time"
            )
        elif self.growth.upper >= 1:
            unmet.append(
                f"it is not decided whether the estimates settle under every jitter: at worst "
                f"their error is multiplied by {self.growth.lower:.6f} to {self.growth.upper:.6f} "
                f"at each sampling time"
            )
        return unmet


def check(scenario: Scenario, find: Find | None = None) -> Check:
    """Return what the theory says of a scenario; `find` as `bounded` has it."""
    topology = topologies_of(scenario).links
    choice, periods = scenario.algorithm, periods_of(scenario)
    algorithm = load_algorithm(choice.name, choice.alpha, choice.beta)
    spectrum, target = spectrum_of(topology), target_of(scenario)
    own = algorithm.conditions(spectrum, periods.longest)
    bounds = [c.right for c in own if c.name == OF_PERIOD]
    conditions = (
        *(c for c in own if periods.alike is not None or c.name != OF_PERIOD),
        *demands(algorithm, periods.longest, *target.bounds()),
        *_gain_conditions(scenario),
        *tracking_conditions(scenario, find),
    )
    network = network_of(topology)
    return Check(
        algorithm=choice.name,
        spectrum=[(float(s.real), float(s.imag)) for s in np.sort_complex(spectrum)],
        growth=growth_of(algorithm, spectrum, periods),
        alpha_beta_bound=smallest_theta(spectrum),
        h_bound=min(bounds, default=None),
        spanning_tree=network.spanning_tree,
        conditions=conditions,
        network=network,
        periods=periods,
    )


def finite(number: float | None) -> float | None:
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
