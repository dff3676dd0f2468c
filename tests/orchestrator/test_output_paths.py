"""What is written never takes the place of a file of another kind, nor of the one that is read."""

import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli import output_paths
from nrs_cosim.orchestrator.cli.output_paths import (
    expect_another,
    expect_replaceable,
    locked,
    place_for,
)
from nrs_cosim.recordings.mcap.container import MAGIC


@pytest.mark.parametrize("held", [b"\x89MCAP0\r\n", b"[run]\n", b"\x89PNG\r\n", b"PK\x03\x04"])
def test_a_file_of_another_kind_is_not_replaced(tmp_path, held):
    path = tmp_path / "file"
    path.write_bytes(held)
    with pytest.raises(InputError, match="exists and is no report"):
        expect_replaceable(path, "report", b"<!doctype html")
    assert path.read_bytes() == held


@pytest.mark.parametrize("held", [None, b"", b"<!DOCTYPE html><title>"])
def test_a_file_of_the_same_kind_or_an_empty_one_is_replaced(tmp_path, held):
    path = tmp_path / "page.html"
    if held is not None:
        path.write_bytes(held)
    expect_replaceable(path, "report", b"<!doctype html")


def test_a_folder_given_as_output_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="is no regular file"):
        expect_replaceable(tmp_path, "report", b"%PDF")


@pytest.mark.parametrize("below", ["x.mcap", "deeper/x.mcap"])
def test_a_file_given_as_output_folder_is_refused(tmp_path, below):
    (tmp_path / "file").touch()
    with (
        pytest.raises(InputError, match=r"file: is a file and not a folder"),
        place_for(tmp_path / "file" / below, "run"),
    ):
        raise AssertionError
    with place_for(tmp_path / "new" / below, "run") as place:
        assert place.written.parent.is_dir()


def test_the_input_is_not_overwritten(tmp_path):
    path = tmp_path / "a.mcap"
    path.write_bytes(b"x")
    (tmp_path / "same.mcap").symlink_to(path)
    with pytest.raises(InputError, match="is the recording itself"):
        expect_another(tmp_path / "same.mcap", path)
    expect_another(tmp_path / "other.mcap", path)
    expect_another(None, path)


def test_a_recording_finished_just_before_the_lock_is_not_replaced(tmp_path, monkeypatch):
    """Between the first look and the lock, another process ends, with a whole recording."""
    path = tmp_path / "run.mcap"
    found = output_paths.locked

    def late(at):
        path.write_bytes(MAGIC + b"whole")
        return found(at)

    monkeypatch.setattr(output_paths, "locked", late)
    with pytest.raises(InputError, match="is there already"), place_for(path, "run"):
        pass
    assert path.read_bytes() == MAGIC + b"whole"


def test_the_lock_is_on_the_current_file(tmp_path, monkeypatch):
    path, other = tmp_path / "run.mcap", tmp_path / "run.mcap.part"
    path.touch()
    lock, renamed = output_paths._lock, []

    def late(descriptor, at):
        lock(descriptor, at)
        if not renamed:
            renamed.append(other.write_bytes(b"x"))
            other.replace(path)

    monkeypatch.setattr(output_paths, "_lock", late)
    with locked(path):
        monkeypatch.setattr(output_paths, "_lock", lock)
        with pytest.raises(InputError, match="is being written by"):
            output_paths.expect_unlocked(path)


def test_a_dangling_link_stays_when_nothing_was_written(tmp_path):
    link, target = tmp_path / "link.mcap", tmp_path / "target.mcap"
    link.symlink_to(target)
    with place_for(link, "run"):
        assert target.exists()
    assert link.is_symlink()
    assert not target.exists()
