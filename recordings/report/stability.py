"""ρ over both gains as a picture: the stronger the colour, the slower errors fall; red, they grow.

Only inline SVG is written, coloured by the page's style sheet.
"""

from html import escape

import numpy as np

from nrs_cosim.recordings.report.subject import GainMap

SIZE, LEFT, BELOW = 300.0, 56.0, 40.0
LEVELS, FASTEST = 8, 1e-3
"""Shades of how slowly errors fall, beside where that is fastest; and a ρ as good as 0."""


def stability(found: GainMap | None) -> str:
    """Return the picture of a map, and what it is; nothing where there is none."""
    if found is None:
        return ""
    (x, y), cell = found.values, SIZE / len(found.radius)
    least = float(np.nanmin(found.radius))
    slow = 1 - np.log(np.maximum(found.radius, FASTEST)) / np.log(np.clip(least, FASTEST, 1 - 1e-9))
    parts = []
    for row, radii in enumerate(found.radius):
        for column, radius in enumerate(radii.tolist()):
            name = f"s{int(slow[row, column] * LEVELS)}" if radius < 1 else "grows"
            at = f'x="{LEFT + column * cell:.2f}" y="{SIZE - (row + 1) * cell:.2f}"'
            parts.append(f'<rect {at} class="{name}"/>')
    most = [2 * values[-1] - (values[-1] + values[-2]) / 2 for values in (x, y)]
    at_x, at_y = LEFT + found.own[0] / most[0] * SIZE, SIZE - found.own[1] / most[1] * SIZE
    names = [escape(name) for name in found.names]
    middle = SIZE / 2
    texts = (
        f'<text x="{LEFT}" y="{SIZE + 18}">0</text>'
        f'<text x="{LEFT + SIZE}" y="{SIZE + 18}" class="end">{most[0]:.3g}</text>'
        f'<text x="{LEFT + middle}" y="{SIZE + 34}" class="mid">{names[0]}</text>'
        f'<text x="{LEFT - 6}" y="14" class="end">{most[1]:.3g}</text>'
        f'<text x="{LEFT - 6}" y="{middle}" class="end">{names[1]}</text>'
    )
    size = f'style="--cell: {cell:.2f}px"'
    label = f"spectral radius over {names[0]} and {names[1]}"
    return (
        f'<svg class="stability" role="img" aria-label="{label}" {size} '
        f'viewBox="0 0 {LEFT + SIZE + 8} {SIZE + BELOW}">{"".join(parts)}{texts}'
        f'<circle cx="{at_x:.1f}" cy="{at_y:.1f}" r="7"/></svg>'
        '<p class="about">ρ with other gains, by theory: the stronger the blue, the slower errors '
        "fall, and where it is red they grow. The ring is this run; the least on this grid is "
        f"{least:.4g}.</p>"
    )
