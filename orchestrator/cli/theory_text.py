"""Convergence and bounds of an experiment, in lines by name."""

from collections.abc import Sequence
from math import inf, isnan
from typing import TYPE_CHECKING

from nrs_cosim.bus.plurals import count_of, numbered
from nrs_cosim.bus.text import shortened
from nrs_cosim.estimator_agents.theory.outermost import known_of, within_of
from nrs_cosim.orchestrator.cli.links_text import (
    CONVERGE,
    link_rows,
    links_sentence,
    noise_sentence,
)
from nrs_cosim.orchestrator.scenario.robot_ids import multiple, with_parameters

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from nrs_cosim.estimator_agents.algorithm import Spectrum
    from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
    from nrs_cosim.estimator_agents.theory.network import NetworkSummary
    from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds
    from nrs_cosim.orchestrator.analysis.conditions import Check
    from nrs_cosim.orchestrator.analysis.plant_bounds import Bounded
    from nrs_cosim.orchestrator.analysis.switching import AnyOrder

ROUNDING = 1e-12
"""Of an eigenvalue, that is not shown."""
MAX_SHOWN = 12
"""Of digraphs, that are shown."""
ALL_HONEST = "robots that do not lie"
"""What a void condition is of."""
UNKNOWN = "whether the estimates converge with these links is not known"
UNKNOWN_OF_HONEST = "whether the honest robots' estimates converge is not known"
"""What follows from a spectral radius where the recursion that is computed is not what runs."""


def convergence_rows(checked: "Check") -> dict[str, str]:
    """Return lines of what the network and the algorithm are."""
    periods = checked.periods
    rows = {
        "algorithm": with_parameters(checked.algorithm, checked.parameters),
        **_networks(checked),
        "rho": _convergence(checked),
        **link_rows(checked.links),
    }
    if checked.any_order:
        of = " (statement D8)" if checked.any_order.over_links else _of(checked)
        rows["any order"] = _any_order(checked.any_order, of)
    if periods.constant_period is None:
        rows["times"] = (
            f"{periods.shortest:g} to {periods.longest:g} s after one another, "
            f"{periods.mean:g} s in the mean"
        )
    if checked.rate > 0:
        rows["rate"] = _rate(checked)
    if liars := checked.byzantine:
        by = "".join(f", robot {robot} by {other}" for robot, other in checked.lying_by)
        rows["byzantine"] = f"{_lie(liars)}{by}; what follows is of the others"
    if hull := checked.hull:
        rows["honest"] = (
            f"positions stay within {_ranges(hull.position)}, and velocities within "
            f"{_ranges(hull.velocity)} in this run, whatever liars send (statement B1)"
        )
    if chords := checked.chords:
        rows["reference"] = (
            f"no line between sampling times: chords of {chords.step:g} s are given to "
            f"{', '.join(map(shortened, chords.fmus))}, off by up to {chords.position:.3g} and, in "
            f"velocity, {chords.velocity:.3g} while the estimated acceleration is within gamma_2"
        )
    return rows


def _ranges(by_axis: "NDArray[np.float64]") -> str:
    found = [f"[{low:.4g}, {high:.4g}]" for low, high in by_axis]
    return found[0] if len({*found}) == 1 else f"{', '.join(found)} by axis"


def _lie(liars: Sequence[int]) -> str:
    return f"{_robots(liars)} lie{'s' * (len(liars) == 1)}"


def _of(checked: "Check") -> str:
    """Return what is said of a number that is not of what runs."""
    return f", of {checked.premise}" if checked.premise else ""


def _networks(checked: "Check") -> dict[str, str]:
    """Return lines of who receives from whom: one digraph in whole, several in short."""
    if checked.network:
        (digraph,) = checked.phases[0].digraphs
        return {
            "network": _ways(checked.network),
            "components": _components(checked.network),
            "spectrum": f"{_spectrum(digraph.spectrum)} (of D, the normalised adjacency)",
        }
    rows = {}
    for phase in checked.phases[:MAX_SHOWN]:
        digraphs = ". ".join(
            f"{digraph.of}: {_ways(digraph.network)}; spectrum {_spectrum(digraph.spectrum)}"
            for digraph in phase.digraphs
        )
        alone = f"; alone it has {_alone(phase.rho)}{_of(checked)}"
        rows[f"k >= {phase.since}"] = digraphs + alone * (len(checked.phases) > 1)
    if len(checked.phases) == 1:
        return {"networks": rows.popitem()[1]}
    more = f", of which {MAX_SHOWN} are shown" if len(checked.phases) > MAX_SHOWN else ""
    end = f"repeated after {checked.repeat} ticks" if checked.repeat else "the last one stays"
    of = "conditions are of the phase that is nearest to them"
    return {"networks": f"{count_of(len(checked.phases), 'phase')}{more}, {end}; {of}", **rows}


def _ways(network: "NetworkSummary") -> str:
    """Say how the target comes to all."""
    return (
        f"a path of at most {count_of(network.depth, 'link')} leads from the target to every robot "
        f"(assumption A2); {_robots(network.pinned)} "
        f"receive{'s' * (len(network.pinned) == 1)} from it"
    )


def _alone(rho: "RadiusBounds") -> str:
    if isnan(rho.upper):
        return "no spectral radius"
    if isnan(rho.radius):
        return f"a spectral radius of {multiple(rho.lower)} to {multiple(rho.upper)}"
    return f"a spectral radius of {multiple(rho.radius)}"


def _convergence(checked: "Check") -> str:
    """Say the spectral radius, and what follows from it."""
    rho, links = checked.rho, checked.links
    if isnan(rho.upper):
        return f"none: {checked.why}"
    if links.source or (checked.premise and not isnan(links.radius.upper)):
        return links_sentence(links)
    if checked.premise:
        lower, upper = multiple(rho.lower), multiple(rho.upper)
        radius = lower if rho.lower == rho.upper else f"{lower} to {upper}"
        worst = "" if rho.lower == rho.upper else ", at worst"
        unknown = UNKNOWN_OF_HONEST if checked.byzantine else UNKNOWN
        return f"spectral radius {radius}{worst}{_of(checked)}: {unknown}"
    if not isnan(rho.radius):
        below = rho.radius < 1
        status = CONVERGE if below else "the estimates diverge"
        return f"spectral radius {multiple(rho.radius)} {'<' if below else '>='} 1: {status}"
    drawn = bool(checked.periods.early)
    status = {
        "proven": CONVERGE + " under every jitter" * drawn,
        "refuted": "under some jitter " * drawn + "the estimates diverge",
        "not decided": checked.undecided,
    }[rho.status]
    bounds = f"{multiple(rho.lower)} to {multiple(rho.upper)}"
    return f"{'joint ' * drawn}spectral radius {bounds}: {status}"


def _rate(checked: "Check") -> str:
    """Say how fast errors fall asymptotically, and the settling time of any initial error."""
    rate = "without limit" if checked.rate == inf else f"{checked.rate:.4g} per s"
    rate += " asymptotically"
    rate += ", at least" * bool(checked.premise or isnan(checked.spectral_radius))
    fallen = checked.settling_time
    if fallen is None:
        return f"{rate}; settling time not computed: {checked.why_unsettled} (statement W8)"
    of = " in all that agents keep (statement W8)" * checked.keeps_more
    return f"{rate}; settling time {fallen:.4g} s, to a millionth of any initial error{of}"


def _any_order(found: "AnyOrder", of: str) -> str:
    """Say whether the estimates would converge whatever the order of phases."""
    bounds = ""
    if found.lower is not None and found.upper is not None:
        below = found.upper == 1 and found.status == "proven"
        upper = "below 1" if below else multiple(found.upper)
        bounds = f"{multiple(found.lower)} to {upper} at worst: "
    phases = ", ".join(map(str, found.order))
    return (
        bounds
        + {
            "proven": "the estimates converge in any order of these digraphs"
            + (", for both gains are below 1" if found.by_gains else ""),
            "refuted": f"the estimates diverge when the order {phases} repeats",
            "not decided": "it is not decided whether the estimates converge in any order",
            "not computed": "not computed, of so many robots or at times that are not periodic",
        }[found.status]
        + of * (found.status != "not computed")
    )


def _components(network: "NetworkSummary") -> str:
    """Say which robots depend on one another."""
    loops = [part for part in network.components if len(part) > 1]
    if not loops:
        return "no robots receive from one another in a loop"
    shown = "; ".join(_robots(part) for part in loops[:4]) + ("; …" if len(loops) > 4 else "")
    return f"{len(network.components)}, strongly connected; of several robots: {shown}"


def _robots(robots: Sequence[int]) -> str:
    return numbered("robot", robots, 8)


def _spectrum(spectrum: "Spectrum") -> str:
    found, within = known_of(spectrum), within_of(spectrum)
    others = "" if within is None else f"; the others are within {within:.6g} of 0"
    if not len(found):
        return f"no eigenvalue known{others}"
    if len(found) <= 24:
        return ", ".join(_complex(s) for s in sorted(found.tolist(), key=_parts_of)) + others
    imaginary = float(abs(found.imag).max())
    parts = f"imaginary parts up to {imaginary:.6g}" if imaginary else "all real"
    return (
        f"{len(found)} {'known ' * bool(others)}eigenvalues, {found.real.min():.6g} to "
        f"{found.real.max():.6g}, {parts}{others}"
    )


def bound_rows(ultimate: "UltimateBounds") -> dict[str, str]:
    """Return lines of what bounds are made of."""
    rows = {
        "target": f"|ups_0|inf <= {ultimate.gamma_1:g}, |a_0|inf <= {ultimate.gamma_2:g} "
        f"(gamma_1, gamma_2 of assumption A1{ultimate.source and ', '}{ultimate.source})"
    }
    if ultimate.why_not:
        of_velocities = ultimate.worst_case is not None
        some = "of velocities alone (statement W5)" if of_velocities else "none"
        rows["bounds"] = f"{some}: {ultimate.why_not}"
    elif ultimate.why_loose:
        rows["bounds"] = (
            f"of step responses, which no target may attain where gamma_1 binds, and none of the "
            f"paper's: {ultimate.why_loose} (statement W8)"
        )
    elif ultimate.paper is None and ultimate.recursions and not ultimate.added:
        several = "a switching topology" if ultimate.switching else "all periods at once"
        of = f"is of {several}" if ultimate.switching or ultimate.aperiodic else "is found"
        rows["norm"] = f"no small-value norm {of}"
    elif ultimate.paper:
        norm = ultimate.paper.norm
        rows["norm"] = (
            f"{norm.value:.6f} of the recursion's matrix, b c = {norm.b * norm.c:.4g}, "
            f"kappa = {ultimate.paper.kappa:.4g} per s ({norm.family})"
        )
    if ultimate.noise:
        rows["noise"] = noise_sentence(ultimate.noise.as_json())
    if ultimate.gaps is not None:
        rows["silence"] = _silence(ultimate.gaps, ultimate.recursions[0].h)
    for part in ultimate.robots:
        name = "P3" if len(ultimate.robots) == 1 else f"P3 of {part.robots[0]}"
        rows[name] = _mechanics(part)
    return rows


def _silence(gaps: "NDArray[np.float64]", h: float) -> str:
    """Say how long robots are silent, and how much they send at most."""
    low, high = gaps.min(), gaps.max()
    some = f"{low:g}" if low == high else f"{low:g} to {high:g}, by robot"
    return (
        f"sampling periods between two samples of a robot: at least {some}; samples of a robot a "
        f"second: at most {(1 / gaps).mean() / h:.4g} in the mean (statement E2)"
    )


def unmet(checked: "Check", ultimate: "UltimateBounds") -> list[str]:
    """Return lines of what is violated or unknown; none where all conditions are known to hold.

    A condition on sampled bounds of a plant is one that holds where it holds of the samples.
    """
    sentences = [
        f"{c.name} ({c.source}) is violated: {c.value:g}, expected "
        f"{'>' if c.at_least else '<'} {c.bound:g}"
        if checked.status(c) == "violated"
        else f"{c.name} ({c.source}) is unknown: {c.value:g}, and its bound is not computed"
        for c in checked.conditions
        if not c.holds
    ]
    sentences += [
        f"{c.name} ({c.source}) is void: it is of {ALL_HONEST}, and {_lie(checked.byzantine)}"
        for c in checked.conditions
        if checked.status(c) == "void"
    ]
    if checked.convergence != "converges":
        status = "violated" if checked.convergence == "diverges" else "unknown"
        sentences.append(f"convergence is {status}: {_convergence(checked)}")
    return sentences + [
        f"the conditions on tracking of {_robots(part.robots)} are unknown: {part.why}"
        for part in ultimate.robots
        if part.constants is None
    ]


def _mechanics(part: "Bounded") -> str:
    p3, of = part.bounds, part.constants
    if p3 is None:
        return part.why
    source = p3.source if p3.states is None else f"{p3.source}, {p3.states} states"
    return (
        f"{part.plant}, {_robots(part.robots)}: lambda m {p3.lambda_m:.4g}, M {p3.lambda_M:.4g}, "
        f"c {p3.lambda_c:.4g}, g {p3.lambda_g:.4g}, d {part.lambda_d:.4g} ({source}); "
        + (
            f"mu {of.mu_1:.4g}, {of.mu_2:.4g}, rho {of.rho_1:.4g}, {of.rho_2:.4g}"
            if of
            else f"Theorems 2 and 3 say nothing: {part.why}"
        )
    )


def _parts_of(number: complex) -> tuple[float, float]:
    return number.real, number.imag


def _complex(number: complex) -> str:
    lost = ROUNDING * max(abs(number), 1)
    real, imag = (part if abs(part) > lost else 0.0 for part in (number.real, number.imag))
    return f"{real:.6g}{f'{imag:+.6g}j' if imag else ''}"
