"""Draw the figures of the documents from recordings: `python -m docs.figures RECORDING FIGURE.png`.

Like the paper's: estimates against the target above, tracking errors below, a line a robot; the
first joint and the first seconds of what a report draws.
"""

import sys
from dataclasses import replace
from pathlib import Path

from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report.figures import figures, groups
from nrs_cosim.recordings.report.print import write_picture


def draw(recording: Path, figure: Path, until: float = 8.0) -> None:
    """Draw the first joint's estimates and tracking errors of a recording, up to a time in s."""
    with Reader(recording) as reader:
        stories = [story_of(reader)]
    estimates, tracking, *_ = figures(stories)
    panels = [panel for panel in (*estimates.panels, *tracking.panels) if panel.joint == 0]
    write_picture(
        [replace(estimates, title="", panels=tuple(panels))], figure, groups(stories), until
    )


if __name__ == "__main__":
    draw(Path(sys.argv[1]), Path(sys.argv[2]))
