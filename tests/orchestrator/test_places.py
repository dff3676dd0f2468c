"""What is written never takes the place of a file of another kind, nor of the one that is read."""

import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.commands.places import expect_another, expect_replaceable, place_for


@pytest.mark.parametrize("held", [b"\x89MCAP0\r\n", b"[run]\n", b"\x89PNG\r\n", b"PK\x03\x04"])
def test_a_file_of_another_kind_is_not_replaced(tmp_path, held):
    path = tmp_path / "file"
    path.write_bytes(held)
    with pytest.raises(InputError, match="exists and is no report"):
        expect_replaceable(path, "report", b"<!doctype html")
    assert path.read_bytes() == held


@pytest.mark.parametrize("held", [None, b"", b"<!DOCTYPE html><title>"])
def test_one_of_the_same_kind_an_empty_one_or_none_is(tmp_path, held):
    path = tmp_path / "page.html"
    if held is not None:
        path.write_bytes(held)
    expect_replaceable(path, "report", b"<!doctype html")


def test_a_folder_is_no_place_for_a_file(tmp_path):
    with pytest.raises(InputError, match="is no regular file"):
        expect_replaceable(tmp_path, "report", b"%PDF")


@pytest.mark.parametrize("below", ["x.mcap", "deeper/x.mcap"])
def test_a_file_is_no_folder(tmp_path, below):
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match=r"file: is a file and not a folder"),
        place_for(tmp_path / "file" / below, "run"),
    ):
        raise AssertionError
    with place_for(tmp_path / "new" / below, "run") as place:
        assert place.written.parent.is_dir()


def test_what_is_read_is_not_written(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"x")
    (tmp_path / "same.mcap").symlink_to(path)
    with pytest.raises(InputError, match="is the recording itself"):
        expect_another(tmp_path / "same.mcap", path)
    expect_another(tmp_path / "other.mcap", path)
    expect_another(None, path)
