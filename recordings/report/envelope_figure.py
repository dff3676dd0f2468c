"""The largest errors over all robots, and what the theory has beside them.

A panel a quantity: what was measured is solid, and each law of the theory has a dash of its own, a
colour too where one recording is drawn, and its name at the end of its line.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from nrs_cosim.recordings.report.curves import Curve, Figure, Panel, kept, logarithmic_panel
from nrs_cosim.recordings.report.data import Story
from nrs_cosim.recordings.units import on_axis, rate_of, unit_over

_NORMS = (
    ("position_estimate", "max ‖ε_i − ε_0‖∞ at t_k"),
    ("velocity_estimate", "max ‖υ_i − υ_0‖∞ at t_k"),
    ("position_tracking", "max ‖e_i‖₂"),
    ("velocity_tracking", "max ‖ė_i‖₂"),
)
_LAWS = {"steady state": ("dash", 1), "worst case": ("dashdot", 2), "paper": ("dot", 3)}
"""Dashes and colours."""
_OTHER = ("dash", 4)


def envelope_figure(stories: Sequence[Story], names: Sequence[str]) -> Figure:
    """Return the figure of envelopes; recordings are called by names."""
    slope = "."
    if any(story.subject.spectral_radius for story in stories):
        slope = (
            ": the slope is that of ρ, the factor that is left of the estimation error after a "
            "sampling period, in steady state."
        )
    return Figure(
        "envelopes",
        "How fast it converges",
        "The largest errors over all robots, and what the theory has beside them" + slope,
        tuple(_panels(stories, names)),
    )


def _panels(stories: Sequence[Story], names: Sequence[str]) -> Iterator[Panel]:
    several = len(stories) > 1
    for field, norm in _NORMS:
        curves: list[Curve] = []
        texts: list[str] = []
        for at, (story, name) in enumerate(zip(stories, names, strict=True)):
            envelope = story.envelopes[field]
            if not len(envelope.t):
                continue
            of, group, ink = (f"{name}: ", name, at) if several else ("", "robots", 0)
            points = kept(envelope.largest, last=story.close(envelope.t))
            x, y = envelope.t[points], envelope.largest[points]
            curves.append(Curve(f"{of}measured", group, x, y, ink, width=_width(at, several)))
            texts.append(name if several else "measured")
            for law, bound in story.subject.bounds.get(field, {}).items():
                if 0 < bound < np.inf:
                    dash, colour = _LAWS.get(law, _OTHER)
                    tint = ink if several else colour
                    ends, both = envelope.t[[0, -1]], np.full(2, bound)
                    curves.append(Curve(f"{of}{law} ≤ {bound:.4g}", group, ends, both, tint, dash))
                    texts.append(f"{law} {bound:.4g}")
            if field == "position_estimate" and story.subject.spectral_radius:
                line = _slope(story, story.subject.spectral_radius, of, group, at, several)
                curves += line
                texts += ["ρ"] * len(line)
        if curves:
            unit = unit_over([story.subject.unit for story in stories])
            unit = rate_of(unit) if field.startswith("velocity") else unit
            yield logarithmic_panel(on_axis(norm, unit), curves, texts)


def _width(at: int, several: bool) -> float:
    """Return how wide a recording's line is: the first is seen behind the others."""
    return 2.6 if several and not at else 1.2


def _slope(
    story: Story, spectral_radius: float, of: str, group: str, at: int, several: bool
) -> list[Curve]:
    """Return the line that falls (or rises) by ρ each period, from the largest error on."""
    envelope = story.envelopes["position_estimate"]
    y = envelope.largest
    if not np.isfinite(y).any():
        return []
    start = int(np.nanargmax(y)) if spectral_radius < 1 else 0
    line = y[start] * spectral_radius ** np.arange(len(y) - start)
    least, most = np.nanmin(y), np.nanmax(y)
    seen = (line >= least) & (line <= most)
    rows = np.flatnonzero(seen)[[0, -1]] if seen.any() else np.empty(0, int)
    name = f"{of}slope of ρ = {spectral_radius:.4f}"
    ink = at if several else None
    return [Curve(name, group, envelope.t[start:][rows], line[rows], ink, "longdash")]
