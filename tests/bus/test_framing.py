"""Parts are framed as one byte string, and come out of it whole or not at all."""

import pytest

from nrs_cosim.bus.framing import joined, parted


def test_a_part_stands_after_its_length_u32_little_endian():
    assert joined([b"ab", b"", b"c" * 258]) == (
        b"\x02\x00\x00\x00ab" + b"\x00\x00\x00\x00" + b"\x02\x01\x00\x00" + b"c" * 258
    )


@pytest.mark.parametrize("parts", [[], [b""], [b"a"], [b"", b"x" * 300, b"\x00" * 4, b""]])
def test_framed_parts_are_unframed_unchanged(parts):
    assert parted(joined(parts)) == parts


def test_frames_one_after_the_other_are_the_frames_of_all_parts():
    assert joined([b"a", b"bc"]) + joined([b"", b"d"]) == joined([b"a", b"bc", b"", b"d"])


@pytest.mark.parametrize("cut", range(1, 8))
def test_a_cut_frame_is_rejected(cut):
    whole = joined([b"ab", b"cd"])
    assert parted(whole[:-cut]) == ([b"ab"] if cut == 6 else None)
