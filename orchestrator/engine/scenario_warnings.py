"""What a scenario asks for that may not be meant: told before a run, and by a check."""

from collections.abc import Iterator

from nrs_cosim.bus.clock import seconds
from nrs_cosim.orchestrator.engine.joint_limits import beyond_limits
from nrs_cosim.orchestrator.engine.recording_size import large_recording
from nrs_cosim.orchestrator.engine.units import mixed_units
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.faults import spans_of


def scenario_warnings(experiment: Experiment) -> list[str]:
    """Return a line for each; `FmuError` where a plant is not found."""
    found = [mixed_units(experiment), large_recording(experiment)]
    return [line for line in found if line] + [
        *beyond_limits(experiment),
        *_idle_outages(experiment),
    ]


def _idle_outages(experiment: Experiment) -> Iterator[str]:
    """Say of each outage in which no sampling time of the run lies."""
    clock, faults = experiment.clock, experiment.scenario.faults
    ends = seconds(clock.t(clock.ticks))
    of_links, of_robots = ([one.outages for one in of] for of in (faults.links, faults.robots))
    for of, entries in (("links", of_links), ("robots", of_robots)):
        for number, spans in enumerate(entries):
            for span, (begin, end) in zip(spans, spans_of(spans), strict=True):
                first = clock.since(begin)
                if first > clock.ticks:
                    why = f"begins after the run, which ends at {ends:g} s"
                elif first >= clock.since(end):
                    why = "has no sampling time in it"
                else:
                    continue
                yield f"faults.{of}[{number}].outages: {[*span]} {why}: nothing is lost by it"
