"""What a mutation is, how it is known, and that the lists beside it are of this tree."""

import ast

import pytest

from tests.mutation.__main__ import ROOT, drawn, equivalents, modules, mutations
from tests.mutation.mutations import mutations_of

SOURCE = '''
"""Text, of which nothing is changed."""

LIMIT = 3

class Seam(Protocol):
    def take(self, seconds: float = 0.0) -> list[int]: ...

class Thing:
    def ε(self, a, b):
        """Text."""
        if a and b:
            raise ValueError(f"{a + b} is wrong")
        self.seen += 1
        for x in sorted(a):
            if x not in b:
                continue
            note(x)
        return -a < b <= 2.5
'''.encode()
CHANGES = {
    ": 3 => (4)",
    "Thing.ε: a and b => (a or b)",
    "Thing.ε: a and b => (not (a and b))",
    'Thing.ε: raise ValueError(f"{a + b} is wrong") => pass',
    "Thing.ε: self.seen += 1 => pass",
    "Thing.ε: 1 => (2)",
    "Thing.ε: sorted(a) => (a)",
    "Thing.ε: x not in b => (x in b)",
    "Thing.ε: continue => break",
    "Thing.ε: note(x) => pass",
    "Thing.ε: return -a < b <= 2.5 => return None",
    "Thing.ε: -a < b <= 2.5 => (-a <= b <= 2.5)",
    "Thing.ε: -a < b <= 2.5 => (-a < b < 2.5)",
    "Thing.ε: -a => (a)",
    "Thing.ε: 2.5 => (6.0)",
}


def test_each_mutation_changes_one_place():
    found = mutations_of("m.py", SOURCE)
    assert {one.key for one in found} == {f"m.py: {change}" for change in CHANGES}
    for one in found:
        changed = one.of(SOURCE)
        assert ast.dump(ast.parse(changed)) != ast.dump(ast.parse(SOURCE))


def test_keys_of_mutations_do_not_depend_on_line_numbers():
    moved = SOURCE.replace(b"\nclass Thing", b"\n\n# a comment\nOTHER = 1 + 1\n\nclass Thing")
    before, after = mutations_of("m.py", SOURCE), mutations_of("m.py", moved)
    assert {one.key for one in before} < {one.key for one in after}
    first = drawn(before, 5, seed=1)
    assert len(first) == 5
    assert [one.key for one in first] == [one.key for one in drawn(before[::-1], 5, seed=1)]
    assert {one.key for one in first} != {one.key for one in drawn(before, 5, seed=2)}
    new = {one.key for one in after} - {one.key for one in before}
    kept = {one.key for one in drawn(after, 5, seed=1)} - new
    assert kept <= {one.key for one in first}


def test_the_same_change_twice_in_a_function_has_two_keys():
    keys = [one.key for one in mutations_of("m.py", b"def f(a):\n    g(a)\n    g(a)\n")]
    assert keys == ["m.py: f: g(a) => pass", "m.py: f: g(a) => pass (2)"]


@pytest.fixture(scope="module")
def found():
    return mutations()


def test_every_module_has_mutations_and_tests(found):
    for module, of in found.items():
        source = (ROOT / module).read_bytes()
        assert len({one.key for one in of}) == len(of) > 0
        for one in drawn(of, 20, seed=1):
            compile(one.of(source), module, "exec")
        assert all(
            (ROOT / test.removeprefix("--deselect=").split("::")[0]).is_file()
            for test in modules()[module]
        )


def test_each_equivalent_mutation_exists_and_has_a_reason(found):
    keys = {one.key for of in found.values() for one in of}
    assert equivalents().keys() <= keys
    assert all(equivalents().values())
