"""What commands take of a large recording: `python -m benchmarks.commands [ROBOTS [TICKS]]`.

A thousand arms for 2,000 ticks are four million messages. Of each command the processor's time and
the most memory are those of its process, and `convert` is also told by its messages.
"""

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.table import keep
from nrs_cosim.recordings.mcap.reader import Reader

QUIET = {**os.environ, "NRS_PROGRESS": "off"}
NRS = str(Path(sys.executable).with_name("nrs"))
COMMANDS = {
    "info": ["info", "run.mcap"],
    "diff, equal": ["diff", "run.mcap", "run.mcap"],
    "diff, one robot differs": ["diff", "run.mcap", "other.mcap"],
    "convert --to ros2": ["convert", "run.mcap", "--to", "ros2", "-o", "bag.mcap"],
    "export, CSV": ["export", "run.mcap", "-o", "csv"],
    "replay --verify": ["replay", "run.mcap", "--verify"],
}
SCENARIO = """
run = {{ duration = {seconds}, sampling_period = 0.1, output_step = 0.1 }}
algorithm = {{ name = "dcea1", alpha = 0.9, beta = 1.1 }}
network = {{ edge_list = {edges} }}
target.axes = [{{ sines = [{{ amplitude = 1.0, frequency = 0.5 }}] }}, {{ offset = 1.0 }}]
plant.fmu = "two_link_arm"
controller = {{ kp = 200.0, kd = 300.0 }}
"""


CHANGE = ["--plant", "robots=3,controller.kp=150"]
"""What makes the other recording."""


def spent(arguments: list[str], folder: Path) -> dict[str, float]:
    """Return the user time, s, and the peak memory, MB, of a command."""
    process = subprocess.Popen([NRS, *arguments], cwd=folder, env=QUIET, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode > (arguments[0] == "diff"):  # which is 1 where they differ
        raise SystemExit(f"nrs {' '.join(arguments)}: ended with status {process.returncode}")
    return {"user_s": usage.ru_utime, "peak_mb": usage.ru_maxrss / 1024}


def main(robots: int = 1000, ticks: int = 2000) -> None:
    """Print the table, and write it as JSON beside."""
    edges = [[0, robot] for robot in range(1, robots + 1)]
    with TemporaryDirectory() as name:
        folder = Path(name)
        scenario = SCENARIO.format(seconds=ticks / 10, edges=edges)
        (folder / "run.toml").write_text(scenario, "utf-8")
        found = {"run": spent(["run", "run.toml", "-o", "run.mcap"], folder)}
        with Reader(folder / "run.mcap") as reader:
            print(f"{reader.message_count:,} messages, {(folder / 'run.mcap').stat().st_size:,} B")
        spent(["replay", "run.mcap", *CHANGE, "-o", "other.mcap"], folder)
        for command, arguments in COMMANDS.items():
            found[command] = spent(arguments, folder)
        for command, of in found.items():
            print(f"{command:<23} {of['user_s']:>7.1f} s {of['peak_mb']:>7.0f} MB")
    keep("commands", {f"{robots} robots, {ticks} ticks": found})


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
