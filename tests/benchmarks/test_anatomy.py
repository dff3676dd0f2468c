"""The parts of a tick are found by name: each is there, and they are nearly all of it."""

import pytest

from benchmarks.anatomy import ALL, BESIDE, PARTS, REST, parts_of, replaced
from nrs_cosim.bus.validation import Wire


def test_every_part_has_a_time_and_little_is_unattributed():
    pack = Wire.pack_block
    found = parts_of(200, 12)
    assert all(found[part] > 0 for part in PARTS)
    assert found[REST] + sum(found[part] for part in PARTS) == pytest.approx(found[ALL])
    assert 0 < found[BESIDE] < found[ALL]
    assert found[REST] < found[ALL] / 3
    assert Wire.pack_block is pack


def test_a_missing_function_is_named():
    with pytest.raises(LookupError, match=r"bus\.validation:Wire\.gone is not there any more"):
        replaced("nrs_cosim.bus.validation:Wire.gone", lambda was: was)
