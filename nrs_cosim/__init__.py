"""Co-simulation of networked robots under sampled interaction, for scripts and notebooks.

    import nrs_cosim as nrs

    scenario = nrs.Scenario.load("paper.toml").replace({"algorithm.alpha": 0.8})
    print(nrs.check(scenario).spectral_radius)
    with nrs.run(scenario, "first.mcap") as recording:
        print(recording.status, recording.errors().dtype.names)

What is imported is loaded when it is first used, so that `import nrs_cosim` costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from nrs_cosim.api.recording import Recording
    from nrs_cosim.api.run import resume, run
    from nrs_cosim.api.scenario import Scenario
    from nrs_cosim.api.theory import Theory, check
    from nrs_cosim.bus.errors import CosimError, InputError, RunError
    from nrs_cosim.estimator_agents.algorithm import Algorithm
    from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate

_HOMES = {
    "Algorithm": "nrs_cosim.estimator_agents.algorithm",
    "CosimError": "nrs_cosim.bus.errors",
    "Disagreement": "nrs_cosim.estimator_agents.estimate",
    "Estimate": "nrs_cosim.estimator_agents.estimate",
    "InputError": "nrs_cosim.bus.errors",
    "Recording": "nrs_cosim.api.recording",
    "RunError": "nrs_cosim.bus.errors",
    "Scenario": "nrs_cosim.api.scenario",
    "Theory": "nrs_cosim.api.theory",
    "check": "nrs_cosim.api.theory",
    "resume": "nrs_cosim.api.run",
    "run": "nrs_cosim.api.run",
}

__all__ = [
    "Algorithm",
    "CosimError",
    "Disagreement",
    "Estimate",
    "InputError",
    "Recording",
    "RunError",
    "Scenario",
    "Theory",
    "check",
    "resume",
    "run",
]


def __getattr__(name: str) -> Any:
    """Load what a public name stands for."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, loaded or not."""
    return sorted({*globals(), *__all__})
