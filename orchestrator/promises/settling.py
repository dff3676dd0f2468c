"""Whether a scenario's estimates settle: the factor that is left of their error at a sampling time.

Of periodic sampling it is ρ of the recursion (paper, Theorems 1 and 3); of other sampling times it
lies between two bounds. It is not a number where the jump is not linear.
"""

from estimator_agents.algorithm import Algorithm, Spectrum
from estimator_agents.theory.aperiodic import Growth, Periods, growth
from estimator_agents.theory.spectrum import spectral_radius
from orchestrator.scenario.clock import seconds
from orchestrator.scenario.setting import clock_of
from orchestrator.scenario.tables import Scenario


def periods_of(scenario: Scenario) -> Periods:
    """Return what periods the sampling times of a scenario may have."""
    clock = clock_of(scenario)
    early = seconds(clock.jitter.most) if clock.jitter else 0.0
    return Periods(tuple(map(seconds, clock.gaps)), early)


def growth_of(algorithm: Algorithm, spectrum: Spectrum, periods: Periods) -> Growth:
    """Return bounds on the factor, from the eigenvalues of D."""
    if periods.alike is None:
        return growth(algorithm, spectrum, periods)
    radius = spectral_radius(algorithm.modes(spectrum, periods.alike))
    return Growth(radius, radius)
