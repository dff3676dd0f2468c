"""One output has one writer, and what is there is replaced by what is complete, when asked for."""

import os
import signal
import subprocess
import sys
from contextlib import closing, contextmanager

import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli import output_paths
from nrs_cosim.orchestrator.cli.output_paths import expect_unlocked, locked, place_for
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.guard import GUARD
from tests.scenarios import SHORT, write

HOLD = (
    "import sys; from pathlib import Path\n"
    "from nrs_cosim.orchestrator.cli.output_paths import locked\n"
    "with locked(Path(sys.argv[1])):\n"
    "    print('held', flush=True); sys.stdin.read()\n"
)


@pytest.fixture
def scenario(tmp_path):
    return write(tmp_path / "short.toml", SHORT)


@contextmanager
def holder(path):
    """A process that holds the lock of a file."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, path], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate(timeout=GUARD)


class TestLock:
    def test_a_second_writer_is_refused_with_the_first_ones_process(self, scenario, tmp_path):
        path = tmp_path / "run.mcap"
        with holder(path) as process:
            for force in ((), ("--force",)):
                done = nrs("run", scenario, "-o", path, *force)
                assert done.returncode == 2
                assert f"is being written by process {process.pid}" in " ".join(done.stderr.split())
            assert path.read_bytes() == b""

    def test_a_run_in_progress_is_not_resumed(self, scenario, tmp_path):
        path = tmp_path / "run.mcap"
        assert nrs("run", scenario, "-o", path).returncode == 0
        path.write_bytes(path.read_bytes()[:-2000])
        with holder(path) as process:
            done = nrs("resume", path, "-o", tmp_path / "new.mcap")
            assert done.returncode == 2
            assert f"is being written by process {process.pid}" in " ".join(done.stderr.split())

    def test_a_killed_process_releases_its_lock(self, tmp_path):
        path = tmp_path / "run.mcap"
        with holder(path) as process:
            with pytest.raises(InputError, match="is being written"):
                expect_unlocked(path)
            os.kill(process.pid, signal.SIGKILL)
            process.wait(GUARD)
            expect_unlocked(path)
            with locked(path):
                pass

    def test_two_runs_in_one_process_exclude_each_other(self, tmp_path):
        with (
            place_for(tmp_path / "run.mcap", "run"),
            pytest.raises(InputError, match=f"is being written by process {os.getpid()}"),
            place_for(tmp_path / "run.mcap", "run"),
        ):
            raise AssertionError

    def test_an_unknown_lock_holder_is_called_another_process(self, tmp_path, monkeypatch):
        monkeypatch.setattr(output_paths, "LOCKS", tmp_path / "none")
        with locked(tmp_path / "a"), pytest.raises(InputError, match="by another process"):
            expect_unlocked(tmp_path / "a")

    def test_a_file_system_without_locks_is_warned_of(self, tmp_path, monkeypatch, capsys):
        def refuse(*_: object) -> None:
            raise OSError(95, "Operation not supported")

        monkeypatch.setattr(output_paths.fcntl, "flock", refuse)
        with locked(tmp_path / "a"):
            pass
        assert "Operation not supported: nothing keeps others" in capsys.readouterr().err


class TestForce:
    def test_an_existing_recording_is_kept_without_force(self, scenario, tmp_path):
        path = tmp_path / "run.mcap"
        assert nrs("run", scenario, "-o", path).returncode == 0
        old = path.read_bytes()
        done = nrs("run", scenario, "-o", path)
        assert done.returncode == 2
        assert "is there already; give another name, or --force" in " ".join(done.stderr.split())
        assert path.read_bytes() == old

    @pytest.mark.parametrize("linked", [False, True])
    def test_the_old_recording_stays_until_the_new_one_is_complete(self, tmp_path, linked):
        path = real = tmp_path / "run.mcap"
        real.write_bytes(OLD)
        if linked:
            path = tmp_path / "link.mcap"
            path.symlink_to(real)
        with place_for(path, "run", force=True) as place:
            assert place.written == tmp_path / "run.mcap.part"
            place.written.write_bytes(b"new")
            assert path.read_bytes() == OLD
            assert place.settle(complete=True) == path
        assert real.read_bytes() == b"new"
        assert path.is_symlink() == linked
        assert not place.written.exists()

    def test_a_failed_run_keeps_the_old_recording_and_says_where_its_own_is(
        self, scenario, tmp_path
    ):
        path = tmp_path / "run.mcap"
        assert nrs("run", scenario, "-o", path).returncode == 0
        old = path.read_bytes()
        write(scenario, SHORT, {"run.divergence_limit": 26.0})
        done = nrs("run", scenario, "-o", path, "--force")
        assert done.returncode == 1
        assert path.read_bytes() == old
        part = tmp_path / "run.mcap.part"
        assert str(part) in done.stdout.replace("\n", "")
        with closing(Reader(part)) as reader:
            assert reader.status == "failed"

    def test_a_partial_recording_is_kept_and_can_be_resumed(self, scenario, tmp_path):
        path, part = tmp_path / "run.mcap", tmp_path / "run.mcap.part"
        assert nrs("run", scenario, "-o", path).returncode == 0
        old = path.read_bytes()
        with Reader(path) as reader:
            digest = reader.digest
        part.write_bytes(old[: old.rindex(b"nrs.end", 0, old.rindex(b"nrs.end"))])  # killed
        left = part.read_bytes()
        assert nrs("run", scenario, "-o", path, "--force").returncode == 0
        assert part.read_bytes() == left
        done = nrs("resume", path, "-o", path, "--force")
        assert done.returncode == 0, done.stderr
        assert f"{part}, which was to take the place of" in done.stderr.replace("\n", " ")
        assert part.read_bytes() == left
        with Reader(path) as reader:
            assert (reader.status, reader.digest) == ("completed", digest)
        assert {each.name for each in tmp_path.glob("*.part*")} == {"run.mcap.part"}

    def test_a_run_that_cannot_start_leaves_no_file(self, tmp_path):
        path = tmp_path / "run.mcap"
        path.write_bytes(OLD)
        with (
            pytest.raises(ValueError, match="before it began"),
            place_for(path, "run", force=True),
        ):
            raise ValueError("before it began")
        assert [each.name for each in tmp_path.iterdir()] == ["run.mcap"]
        with pytest.raises(ValueError, match="again"), place_for(tmp_path / "new.mcap", "run"):
            raise ValueError("again")
        assert [each.name for each in tmp_path.iterdir()] == ["run.mcap"]


OLD = b"\x89MCAP0\r\n and so on"
