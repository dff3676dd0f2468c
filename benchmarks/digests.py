"""One digest, however and wherever the paper's example is run: each way by a command of its own.

A way is options of `nrs run`, or an environment: another compiler, which compiles all anew; none,
so that NumPy does the ticks and the chunks; a processor that has less. What a machine lacks is
named. Other architectures are emulated by tests/plant_fmu/test_same_bits.py, models alone.
"""

import os
import shutil
import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from numpy._core import _multiarray_umath as numpy_core

from benchmarks.table import machine, text
from nrs_cosim.plant_fmu import cache
from nrs_cosim.recordings.mcap.reader import Reader

SCENARIO = Path(__file__).parents[1] / "scenarios" / "paper_first_order.toml"
OPTIONS: Mapping[str, Sequence[str]] = {
    "one process, one thread": ("--threads", "1"),
    "two threads": ("--threads", "2"),
    "three workers": ("--workers", "3"),
    "a batch for each tick": ("--realtime", "1e6"),
    "chunks that are not compressed": ("--compression", "none"),
}
NO_COMPILER = "NumPy, without a compiler"
FEATURES = " ".join(f for f in numpy_core.__cpu_dispatch__ if numpy_core.__cpu_features__[f])
ENVIRONMENTS: Mapping[str, Mapping[str, str]] = {
    NO_COMPILER: {"CC": "false"},
    "NumPy without what it takes of the processor": {"NPY_DISABLE_CPU_FEATURES": FEATURES},
    "glibc without AVX2 and FMA": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F"},
}
COMPILERS = {
    "gcc": "gcc",
    "gcc, for this very processor": "gcc -march=native",
    "clang": "clang",
    "zig": f"{sys.executable} -m ziglang cc",
}


def digest(path: Path, options: Sequence[str] = (), **environment: str) -> str:
    """Return the digest of a run into a file, with options and in an environment."""
    command = [sys.executable, "-m", "nrs_cosim.orchestrator", "run", SCENARIO, "-o", path]
    env = os.environ | environment
    subprocess.run([*command, "--force", *options], check=True, capture_output=True, env=env)
    with Reader(path) as reader:
        return reader.digest


def is_there(compiler: str) -> bool:
    """Return whether a compiler is installed."""
    if "ziglang" in compiler:
        return find_spec("ziglang") is not None
    return shutil.which(compiler.split(maxsplit=1)[0]) is not None


def ways(folder: Path) -> dict[str, str]:
    """Return the digest of each way, in their order; empty where something is not installed."""
    path = folder / "run.mcap"
    found = {way: digest(path, options) for way, options in OPTIONS.items()}
    fmus = folder / "fmus"
    shutil.copytree(cache.cache_folder(), fmus, ignore=shutil.ignore_patterns("*.so*", "*.dylib*"))
    for way, environment in ENVIRONMENTS.items():
        elsewhere = {"NRS_CACHE": str(fmus)} if way == NO_COMPILER else {}
        found[way] = digest(path, **environment, **elsewhere)
    for way, compiler in COMPILERS.items():
        empty = {"NRS_CACHE": str(folder / way), "CC": compiler}
        found[f"compiled by {way}"] = digest(path, **empty) if is_there(compiler) else ""
    return found


def main() -> None:
    """Print the table; fail where two digests differ."""
    ArgumentParser(description="the digest of the paper's example, run in many ways").parse_args()
    print(f"{text(machine())}\n")
    with TemporaryDirectory(prefix="nrs-") as folder:
        found = ways(Path(folder))
    for way, of in found.items():
        print(f"{way:46}{of[:16] or 'not installed here'}")
    if len({of for of in found.values() if of}) != 1:
        raise SystemExit("digests differ")


if __name__ == "__main__":
    main()
