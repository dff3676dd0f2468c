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
    from nrs_cosim.api import errors, replay
    from nrs_cosim.api.design import design
    from nrs_cosim.api.recording import Recording
    from nrs_cosim.api.replay import compare
    from nrs_cosim.api.run import resume, run
    from nrs_cosim.api.scenario import Scenario
    from nrs_cosim.api.study import Study
    from nrs_cosim.api.sweep import sweep
    from nrs_cosim.api.theory import Theory, check
    from nrs_cosim.bus.fields import Field
    from nrs_cosim.estimator_agents.algorithm import Algorithm
    from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
    from nrs_cosim.estimator_agents.parameters import parameter
    from nrs_cosim.estimator_agents.values import Values

_HOMES = {
    "Algorithm": "nrs_cosim.estimator_agents.algorithm",
    "Disagreement": "nrs_cosim.estimator_agents.estimate",
    "Estimate": "nrs_cosim.estimator_agents.estimate",
    "Field": "nrs_cosim.bus.fields",
    "Recording": "nrs_cosim.api.recording",
    "Scenario": "nrs_cosim.api.scenario",
    "Study": "nrs_cosim.api.study",
    "Theory": "nrs_cosim.api.theory",
    "Values": "nrs_cosim.estimator_agents.values",
    "check": "nrs_cosim.api.theory",
    "compare": "nrs_cosim.api.replay",
    "design": "nrs_cosim.api.design",
    "errors": "nrs_cosim.api",
    "parameter": "nrs_cosim.estimator_agents.parameters",
    "replay": "nrs_cosim.api",
    "resume": "nrs_cosim.api.run",
    "run": "nrs_cosim.api.run",
    "sweep": "nrs_cosim.api.sweep",
}

__all__ = [
    "Algorithm",
    "Disagreement",
    "Estimate",
    "Field",
    "Recording",
    "Scenario",
    "Study",
    "Theory",
    "Values",
    "check",
    "compare",
    "design",
    "errors",
    "parameter",
    "replay",
    "resume",
    "run",
    "sweep",
]


if not TYPE_CHECKING:  # a checker takes a module with it to have any name

    def __getattr__(name: str) -> Any:
        """Load what a public name stands for."""
        if name not in _HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        home = _HOMES[name]
        is_module = home == "nrs_cosim.api"
        value = import_module(f"{home}.{name}") if is_module else getattr(import_module(home), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    """Return the public names, loaded or not."""
    return sorted({*globals(), *__all__})
