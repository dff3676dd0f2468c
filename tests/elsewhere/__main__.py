"""Other engines run exported systems, and must come to the very same doubles.

    python -m tests.elsewhere PYTHON

PYTHON is that of an environment into which the engines are installed, at the versions of those that
`benchmarks.peers` measures. It ends with status 1 where one cannot be, fails, or comes to another
number at any sampling time.
"""

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.elsewhere import engines
from tests.scenarios import write

PINS = Path(__file__).parents[2] / "benchmarks" / "peers" / "requirements.txt"
PACKAGES = ("ecospy", "tbb", "libcosimpy", "fmpy", "numpy")
RING = {
    "network": {"generator": {"kind": "ring", "n": 100, "pinned": [1]}},
    "algorithm": {"name": "dcea1", "alpha": 0.9, "beta": 0.9},
}
THIRD = {"algorithm": {"name": "dcea3", "alpha": 0.9, "beta": 0.8, "gamma": 0.7}}
TRACK = {"kind": "sampled", "times": [0.0, 20.0, 60.0], "positions": [[0, 0], [9, -4], [3, 5]]}
PAPER = "paper_first_order"
RUNS = {
    "paper": (PAPER, {}),
    "ring": (PAPER, RING),
    "third_order": (PAPER, THIRD),
    "switching": ("switching", {}),
    "hetero_information": ("hetero_information", {}),
    "sampled": (PAPER, {"target": TRACK}),
}


def main(python: str) -> int:
    """Return the exit status."""
    install = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*install, "--constraint", str(PINS), *PACKAGES], check=True)
    failed = 0
    with TemporaryDirectory() as folder:
        for name, (base, changes) in RUNS.items():
            scenario = str(write(Path(folder, f"{name}.toml"), changes, base=base))
            recording, system = (str(Path(folder, name + end)) for end in (".mcap", ".ssp"))
            command = [sys.executable, "-m", "nrs_cosim"]
            for words in (
                ["run", scenario, "-o", recording],
                ["export", recording, "--to", "ssp", "-o", system],
            ):
                subprocess.run([*command, *words], check=True, stdout=subprocess.DEVNULL)
            for engine in engines.ENGINES:
                print(f"{name}, ", end="", flush=True)
                done = subprocess.run(
                    [python, engines.__file__, engine, system],
                    check=False,
                    stderr=subprocess.DEVNULL,
                )
                failed += done.returncode != 0
    return failed and 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
