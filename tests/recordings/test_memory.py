"""Reading takes no more memory for a long recording than for a short one."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.recordings.made_up_runs import create, tick

ROOT = Path(__file__).parents[2]
READ = """
import sys
from pathlib import Path
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, measure
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.copy import recover
from nrs_cosim.recordings.ros2.conversion import convert
path = Path(sys.argv[1])
with Reader(path, verify=True) as reader:
    describe(reader, experiment_of(reader)), measure(reader, experiment_of(reader))
    export(reader, path.with_suffix(""), sys.argv[2])
    recover(reader, path.with_suffix(".new"))
    convert(reader, path.with_suffix(".bag.mcap"))
status = Path("/proc/self/status").read_text()
print(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")))
"""
N, TICKS = 200, 300


def peak_of_reading(path: Path, form: str) -> float:
    """MB that a process had at most that read all of a recording in all ways."""
    done = subprocess.run(
        [sys.executable, "-c", READ, path, form],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    for made in (".new", ".bag.mcap"):
        path.with_suffix(made).unlink()
    return int(done.stdout) / 1000


@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak from /proc")
def test_peak_memory_does_not_grow_with_the_file(tmp_path: Path) -> None:
    short, long = tmp_path / "short.mcap", tmp_path / "long.mcap"
    for path, ticks in ((short, 5), (long, TICKS)):
        with create(path, N, 2, ticks, (), compression="none") as writer:
            for k in range(ticks + 1):
                writer.write(tick(k, N, 2))
            writer.finish("completed")
    assert long.stat().st_size > 25e6
    assert peak_of_reading(long, "csv") - peak_of_reading(short, "csv") < 10
    assert peak_of_reading(long, "parquet") < 300
