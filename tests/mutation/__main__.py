"""How many of the mutations of the core are found by the tests that are meant to find them.

    make mutants                        a sample, the same for the same seed
    make mutants ARGS="--all bus/validation.py"

Each is tried in a copy of the tree, by the test files that `modules.toml` gives its module, after
those have passed without one. It is killed when a test fails, or when it takes far longer than
without. Those that `equivalents.toml` has, with its reason, change nothing that can be seen.
"""

import argparse
import subprocess
import sys
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.mutation.mutations import Mutation, mutations_of
from tests.mutation.trying import Tree

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
SAMPLE, SEED, DEMANDED = 150, 20261128, 0.95


def modules() -> Mapping[str, Sequence[str]]:
    """Return the test files of each module of the core, the quickest first."""
    return tomllib.loads((HERE / "modules.toml").read_text("utf-8"))["modules"]


def equivalents() -> Mapping[str, str]:
    """Return the mutations that change nothing, by key, and why."""
    listed = tomllib.loads((HERE / "equivalents.toml").read_text("utf-8"))
    return {one["key"]: one["reason"] for one in listed.get("equivalent", ())}


def mutations() -> dict[str, list[Mutation]]:
    """Return all mutations, by module."""
    return {module: mutations_of(module, (ROOT / module).read_bytes()) for module in modules()}


def drawn(found: Sequence[Mutation], most: int, seed: int) -> list[Mutation]:
    """Return at most so many, drawn by a seed, in the order of the text."""
    chosen = sorted(found, key=lambda one: one.rank(seed))[:most]
    return sorted(chosen, key=lambda one: (one.start, one.new))


def main() -> None:
    """Try them, show a table, and fail where too few are killed."""
    parser = argparse.ArgumentParser(prog="make mutants")
    parser.add_argument("modules", nargs="*", help="of these alone")
    parser.add_argument("--sample", type=int, default=SAMPLE, help=f"how many, {SAMPLE}")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--all", action="store_true", help="each of them, which takes hours")
    result = parser.parse_args()
    known, found, tests = equivalents(), mutations(), modules()
    if unknown := set(result.modules) - set(found):
        parser.error(f"{min(unknown)}: is not in tests/mutation/modules.toml")
    each = max(1, -(-result.sample // len(found)))
    chosen = {
        module: of if result.all else drawn(of, each, result.seed)
        for module, of in found.items()
        if not result.modules or module in result.modules
    }
    with tempfile.TemporaryDirectory(prefix="nrs-mutants-") as folder:
        results = _tried(Tree.copied(ROOT, Path(folder)), chosen, tests, known)
    _show(chosen, results, known)
    killed = sum(results.values())
    if not results or killed < DEMANDED * len(results):
        sys.exit(f"{killed} of {len(results)} are killed; {DEMANDED:.0%} are demanded")


def _tried(
    tree: Tree,
    chosen: Mapping[str, Sequence[Mutation]],
    tests: Mapping[str, Sequence[str]],
    known: Mapping[str, str],
) -> dict[Mutation, bool]:
    """Return whether each mutation was killed, but for those that are known to change nothing."""
    results = {}
    for module, of in chosen.items():
        rest = [one for one in of if one.key not in known]
        if not rest:
            continue
        usual = tree.usual(tests[module])
        for one in rest:
            how = tree.tried(one, tests[module], usual)
            results[one] = how != "survived"
            print(f"{how:9} line {one.line:3}  {one.key}", flush=True)
    return results


def _show(
    chosen: Mapping[str, Sequence[Mutation]],
    results: Mapping[Mutation, bool],
    known: Mapping[str, str],
) -> None:
    by_module = defaultdict(list)
    for one, killed in results.items():
        by_module[one.module].append(killed)
    print(f"\n{'module':44} {'tried':>6} {'killed':>7} {'equivalent':>11}")
    for module, of in chosen.items():
        found, equal = by_module[module], sum(one.key in known for one in of)
        print(f"{module:44} {len(found):6} {sum(found):7} {equal:11}")
    share = sum(results.values()) / len(results) if results else 0
    equal = sum(one.key in known for of in chosen.values() for one in of)
    print(f"{'all':44} {len(results):6} {sum(results.values()):7} {equal:11}   {share:.1%} killed")


if __name__ == "__main__":
    try:
        main()
    except subprocess.SubprocessError as error:
        sys.exit(str(error))
