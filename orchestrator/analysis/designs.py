"""What is best for a scenario, as changes of it: gains, period, jitter, pinned robots, accuracy."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import ceil, floor, isfinite, isnan, log10
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectra
from nrs_cosim.estimator_agents.parameters import Declared
from nrs_cosim.estimator_agents.theory.aperiodic import Periods
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.fastest import (
    best_pins,
    fastest_alone,
    fastest_together,
    least,
)
from nrs_cosim.estimator_agents.theory.recursion import linear_jump
from nrs_cosim.estimator_agents.theory.spectrum import spectrum_of
from nrs_cosim.orchestrator.analysis.accuracy import accuracy_rows, designed
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.convergence import periods_of, rho_alone, spectra_of
from nrs_cosim.orchestrator.analysis.link_designs import (
    expect_honest,
    expect_sound,
    factor_at,
    first_failing_period,
    radius_name,
    why_not_designed,
)
from nrs_cosim.orchestrator.analysis.plant_bounds import Find
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.times import longest_part

DIGITS = 6
"""Of gains that are chosen."""
WITHIN = 0.999
"""The part of the longest period that is chosen: at the bound errors stay."""
HALVINGS = 8
"""Of the jitter between none and a period."""
AWAY, OVER_LINKS = 4.0, 8
"""How far from the best gains of sound links others are tried, by a factor; and how finely."""
ROBOTS = 1000
"""Of which the best to pin are looked for."""


@dataclass(frozen=True, slots=True)
class ScenarioDesign:
    """What is best, and the keys of the scenario that make it so."""

    goal: str
    values: dict[str, Any]
    """What was found, by name; for JSON."""
    rows: dict[str, str]
    """The same in words."""
    changes: dict[str, Any]
    """Keys of the scenario with their values; None takes one out."""


def fastest(experiment: Experiment) -> ScenarioDesign:
    """Return the gains alpha and beta of the least spectral radius (G1, G2)."""
    algorithm, h = experiment.algorithm, _period(experiment)
    expect_honest(experiment)
    (spectra,) = _spectra(experiment)
    names = free_gains(algorithm)
    found = linear_jump(algorithm)
    if not names or found is None:
        raise InputError(f"{experiment.name}: the algorithm has no gains alpha and beta to choose")

    def with_gains(gains: Sequence[float]) -> Algorithm:
        pairs = zip(names, gains, strict=True)
        made: Algorithm = replace(algorithm, **dict(pairs))  # type: ignore[type-var]
        return made

    def radius(gains: Any) -> float:
        changed = with_gains([float(gain) for gain in gains])
        rho = factor_at(experiment.with_algorithm(changed), spectra, h)
        return float("inf") if isnan(rho) else rho

    given = [getattr(algorithm, name) for name in names]
    before = radius(given)
    if experiment.impaired and not isfinite(before):
        raise InputError(why_not_designed(experiment))
    best, source = _in_closed_form(*found, given, spectra, h)
    closed = bool(best) and not experiment.impaired
    if not closed:
        fine = (OVER_LINKS, OVER_LINKS) if experiment.impaired else ()
        low = np.array([1e-3 if name == "alpha" else 1e-2 for name in names])
        high = np.array([20 / h if name == "alpha" else 4.0 for name in names])
        if best:  # of sound links, near to which those over these are
            low, high = np.array(best) / AWAY, np.array(best) * AWAY
        best = least(radius, low, high, *fine).tolist()
    best = [float(f"{value:.{DIGITS}g}") for value in best]
    rho = radius(best)
    gains = dict(zip(names, best, strict=True))
    name = radius_name(experiment)
    how = f"the least there is ({source})" if closed else "the least that a search finds"
    return ScenarioDesign(
        "fastest",
        {**gains, "spectral_radius": rho, "before": before, "source": source if closed else ""},
        {
            "fastest": ", ".join(f"{name} = {value:g}" for name, value in gains.items())
            + f": {name} {rho:.6g}, {how}; {before:.6g} before"
        },
        {f"algorithm.{name}": value for name, value in gains.items()},
    )


def _in_closed_form(
    keep: NDArray[np.float64],
    gain: NDArray[np.float64],
    given: Sequence[float],
    spectra: Spectra,
    h: float,
) -> tuple[list[float], str]:
    """Return the gains of least ρ in place of those given, and by what; none for no DCEA.

    K and G, (2, 2), are what the algorithm does with those.
    """
    if not np.array_equal(keep, np.eye(2)):
        return [], ""
    if np.array_equal(gain, np.diag(np.resize(given, 2))) and len(given) == 2:
        return [fastest_alone(spectra[0]), fastest_alone(spectra[-1])], "statement G1"
    together = not gain[0].any() and np.array_equal(gain[1, : len(given)], given)
    if together and len(spectra) == 1:
        beta = None if len(given) == 2 else float(gain[1, 1])
        return [*fastest_together(spectra[0], h, beta)][: len(given)], "statement G2"
    return [], ""


def longest_period(experiment: Experiment) -> ScenarioDesign:
    """Return the largest h below which the estimates converge (G3)."""
    h = _period(experiment)
    expect_honest(experiment)
    if experiment.impaired:
        return _period_over_links(experiment, h)
    bound = check(experiment).h_bound
    if bound is None or not isfinite(bound):
        raise InputError(f"{experiment.name}: no bound on the period is known of the algorithm")
    if not bound > 0:
        raise InputError(f"{experiment.name}: the estimates converge at no period")
    h = _rounded_down(WITHIN * bound)
    return ScenarioDesign(
        "period",
        {"bound": bound, "period": h, "source": "statement G3"},
        {"period": f"h < {bound:.6g} s for convergence (statement G3); {h:g} s is chosen"},
        _with_period(experiment, h),
    )


def _period_over_links(experiment: Experiment, h: float) -> ScenarioDesign:
    """Return the largest period below the first of those tried at which errors do not shrink."""
    (spectra,) = _spectra(experiment)
    first, low, high = first_failing_period(experiment, spectra, h)
    period = _rounded_down(WITHIN * low)
    return ScenarioDesign(
        "period",
        {"bound": high, "period": period, "source": ""},
        {
            "period": "over these links the estimates converge at all periods that were tried from "
            f"{first:.3g} s on, and not at {high:.6g} s; {period:g} s is chosen"
        },
        _with_period(experiment, period),
    )


def largest_jitter(experiment: Experiment) -> ScenarioDesign:
    """Return the largest jitter under which every draw of it converges, by proof (G3)."""
    algorithm, h = experiment.algorithm, experiment.scenario.run.sampling_period
    expect_sound(experiment, "a jitter")
    (spectra,) = _spectra(experiment)
    if h is None or len(spectra) > 1:
        raise InputError(f"{experiment.name}: jitter is of one digraph and a sampling_period")

    def proven(share: float) -> bool:
        return rho_alone(algorithm, spectra, Periods((h,), share * h)).upper < 1

    low, high = 0.0, 0.99
    if proven(high):
        low = high
    elif not rho_alone(algorithm, spectra, Periods((h,))).upper < 1:
        raise InputError(f"{experiment.name}: the estimates do not converge without jitter")
    for _ in range(HALVINGS if low < high else 0):
        middle = (low + high) / 2
        low, high = (middle, high) if proven(middle) else (low, middle)
    share = floor(low * 1000) / 1000
    return ScenarioDesign(
        "jitter",
        {"jitter": share, "not_proven": high if low < high else None},
        {
            "jitter": f"convergence under every jitter of up to {share:g} of the period is proven "
            "(statement G3)"
        },
        {"run.sampling_jitter": share},
    )


def best_pinning(experiment: Experiment, count: int) -> ScenarioDesign:
    """Return the robots to pin, so many, for the least spectral radius (G4)."""
    expect_sound(experiment, "pinning")
    (digraph,) = _one_digraph(experiment)
    n, h, algorithm = digraph.n, _period(experiment), experiment.algorithm
    if n > ROBOTS or count > n:
        raise InputError(f"--pin: expected at most {min(n, ROBOTS)} of {n} robots, got {count}")
    among = digraph.source > 0
    pins = digraph.weight[~among]
    weight = float(pins[0]) if len(pins) else 1.0

    def pinned(robots: Sequence[int]) -> Topology:
        return Topology.of_edges(
            n,
            np.concatenate([digraph.source[among], np.zeros(len(robots), np.intp)]),
            np.concatenate([digraph.sink[among], robots]),
            np.concatenate([digraph.weight[among], np.full(len(robots), weight)]),
        )

    def cost(robots: Sequence[int]) -> tuple[float, ...]:
        topology = pinned(robots)
        left = int((topology.steps() < 0).sum()) + int((topology.in_degree == 0).sum())
        if left:
            return float(left), 0.0
        return 0.0, rho_alone(algorithm, (spectrum_of(topology),), Periods((h,))).radius

    chosen, best = best_pins(n, count, cost)
    gap = cost(chosen)[1] - cost(best)[1] if best else None
    chosen = best or chosen
    unreached, rho = cost(chosen)
    if unreached:
        raise InputError(f"--pin {count}: no {count} robots reach all others; give a larger number")
    said = "the least of all sets" if best else "the least that was found; not all sets were tried"
    topology = pinned(chosen)
    edges = zip(topology.source, topology.sink, topology.weight, strict=True)
    return ScenarioDesign(
        "pinning",
        {"pinned": list(chosen), "spectral_radius": rho, "gap_of_greedy": gap},
        {"pinning": f"robots {', '.join(map(str, chosen))}: spectral radius {rho:.6g}, {said}"},
        {
            "network.adjacency": None,
            "network.pinning": None,
            "network.edge_list": [[int(j), int(i), float(w)] for j, i, w in edges],
        },
    )


def accurate(
    experiment: Experiment, wanted: EstimateBounds, share: float, find: Find | None = None
) -> ScenarioDesign:
    """Return gains and a period that are proven to keep robots as near as wanted (G5)."""
    expect_sound(experiment, "an accuracy")
    found = designed(experiment, wanted, share, find)
    if found is None:
        raise InputError(
            f"{experiment.name}: no accuracy is proven: P3 is not known of all plants, or gains "
            "are not diagonal"
        )
    own = [robot.id for robot in experiment.scenario.robots if robot.controller is not None]
    if own:
        raise InputError(f"robots[{own[0]}].controller: gains are designed for all robots alike")
    if experiment.scenario.controller.frequency is not None:
        raise InputError("controller.frequency: kp and kd are designed, which go not beside it")
    changes: dict[str, Any] = {}
    gains = found.proven
    if gains is not None and gains.period is not None:
        changes = {"controller.kp": _up(gains.kp), "controller.kd": _up(gains.kd)}
        h = experiment.scenario.run.sampling_period
        if h is None or h > WITHIN * gains.period:
            changes |= _with_period(experiment, _rounded_down(WITHIN * gains.period))
    return ScenarioDesign("accuracy", found.as_json(), accuracy_rows(found, wanted), changes)


def _up(gain: float) -> float:
    """Return a gain of six digits, no less than it was."""
    unit = 10.0 ** (floor(log10(gain)) - DIGITS + 1)
    return float(f"{ceil(gain / unit) * unit:.{DIGITS}g}")


def _rounded_down(h: float) -> float:
    """Return h, s, of three digits and in whole ns, no more than it was."""
    unit = max(10.0 ** (floor(log10(h)) - 2), 1e-9)
    return float(f"{floor(h / unit) * unit:.9g}")


def _with_period(experiment: Experiment, h: float) -> dict[str, Any]:
    """Return the changes for a sampling period: the duration is a whole number of them.

    The output step, where one is given, is the longest part of it that is no longer than it was.
    """
    end, step = experiment.scenario.run.end or h, experiment.scenario.run.output_step
    return {
        "run.sampling_period": h,
        "run.output_step": longest_part(h, step) if step else None,
        "run.duration": float(f"{ceil(end / h * (1 - 1e-9)) * h:.12g}"),
    }


def free_gains(algorithm: Algorithm) -> list[str]:
    """Return which of alpha and beta an algorithm has that are not declared to have one value."""
    return [
        field.name
        for field in fields(algorithm)  # type: ignore[arg-type]
        if field.name in {"alpha", "beta"} and not _is_fixed(field.metadata)
    ]


def _is_fixed(metadata: Mapping[Any, Any]) -> bool:
    """Return whether a parameter is declared to have one value."""
    bounds = metadata[Declared].bounds if Declared in metadata else {}
    return "most" in bounds and bounds.get("least") == bounds["most"]


def _period(experiment: Experiment) -> float:
    h = periods_of(experiment).constant_period
    if h is None:
        raise InputError(f"{experiment.name}: a design is of a constant sampling period")
    return h


def _one_digraph(experiment: Experiment) -> Sequence[Topology]:
    digraphs = experiment.topologies.digraphs
    if len(digraphs) > 1:
        raise InputError(f"{experiment.name}: pinning is chosen for one digraph")
    return digraphs


def _spectra(experiment: Experiment) -> Sequence[Any]:
    found = spectra_of(experiment.topologies)
    if len(found) > 1:
        raise InputError(f"{experiment.name}: a design is of a network that does not switch")
    return found
