"""What a recording has of the sampling times, as the answers that engines must come to.

A row a tick and node: the sample as a left limit, and the q and q̇ of a robot; the target, robot 0,
has none. Numbers are in their shortest form that reads back to the same bits.
"""

import csv
from io import StringIO

import numpy as np

from nrs_cosim.bus.fields import column_names
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.export.tables import SAMPLES, STATES, rows
from nrs_cosim.recordings.mcap.reader import Reader

FIELDS = ("position", "velocity", "q", "qd")


def answers(reader: Reader, experiment: Experiment) -> str:
    """Return a recording's table as CSV; it begins with k and robot."""
    n, m, clock = experiment.n, experiment.m, experiment.clock
    found = np.full((reader.ticks + 1, n + 1, len(FIELDS), m), np.nan)
    for table, read in rows(reader, (SAMPLES, STATES)):
        here = read[read["k"] <= reader.ticks]
        part = here[here["time_ns"] == [clock.t(k) for k in here["k"].tolist()]]
        first = 0 if table is SAMPLES else 2
        for place, field in enumerate(("position", "velocity"), first):
            found[part["k"], part["robot"], place] = part[field]
    text = StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["k", "robot", *(name for field in FIELDS for name in column_names(field, (m,)))])
    for k, robot in np.ndindex(found.shape[:2]):
        numbers = found[k, robot].ravel().tolist()
        if k:  # no sample travels at t_0
            out.writerow([k, robot, *("" if np.isnan(number) else number for number in numbers)])
    return text.getvalue()
