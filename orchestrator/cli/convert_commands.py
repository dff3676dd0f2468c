"""`nrs convert`: a recording for the tools of others."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli.options import (
    Epoch,
    OfRobots,
    RecordingPath,
    Since,
    Until,
    epoch_ns_of,
)
from nrs_cosim.orchestrator.terminal import err, out, say

_BAG = "a bag is a folder; give the folder's name, or FILE.mcap for a file alone"


def convert(
    recording: RecordingPath,
    _to: Annotated[
        Literal["ros2"],
        typer.Option(
            "--to",
            help="ros2: joints, frames and robot descriptions, for ROS 2, Rerun, Foxglove and "
            "PlotJuggler; ROS is not needed.",
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="DIR|FILE.mcap",
            help="A new folder with the file and its metadata.yaml, or the file alone.",
        ),
    ],
    robots: OfRobots = None,
    since: Since = None,
    until: Until = None,
    epoch: Epoch = 0,
) -> None:
    """Write a recording as other tools have it: joints by their names, arms that move."""
    from nrs_cosim.bus.clock import NS_PER_S
    from nrs_cosim.bus.plurals import numbered
    from nrs_cosim.orchestrator.cli.formats import expect_folder_name
    from nrs_cosim.orchestrator.cli.output_paths import expect_folder
    from nrs_cosim.orchestrator.cli.progress import reading
    from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots
    from nrs_cosim.recordings.mcap.reader import Reader
    from nrs_cosim.recordings.ros2.conversion import convert as converted
    from nrs_cosim.recordings.schemas import about

    if output.suffix.lower() != ".mcap":
        expect_folder_name("-o", output, _BAG)
    expect_folder(output.parent)
    if output.exists() and not (output.is_dir() and not any(output.iterdir())):
        raise InputError(f"{output}: is there already; give another name")
    with reading(err) as follow, Reader(recording, watch=follow(recording)) as reader:
        reader.expect_ticks("convert")
        said = about(reader)
        wanted = None if robots is None else parse_robots(robots, "--robots", said.run.robots)
        epoch_ns = epoch_ns_of(epoch, reader)
        start_ns, end_ns = (None if t is None else round(t * NS_PER_S) for t in (since, until))
        converted(
            reader, output, robots=wanted, start_ns=start_ns, end_ns=end_ns, epoch_ns=epoch_ns
        )
    out.print(str(output), markup=False)
    unknown = [i for i in wanted or range(1, said.run.robots + 1) if i not in said.urdfs]
    if unknown:
        say(
            "yellow",
            "frames",
            f"there are none of {numbered('robot', unknown, 8)}: no URDF is known",
        )
    for damage in reader.damage:
        say("yellow", "damage", damage)
