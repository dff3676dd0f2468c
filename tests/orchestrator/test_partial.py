"""Of a recording that is not whole nothing is said as of the whole: no digest, error or status."""

import json

import pytest

from nrs_cosim.recordings.mcap.container import RECORD
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from tests.command import nrs
from tests.scenarios import SHORT, write


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A recording of 10 ticks, each in a chunk of its own."""
    folder = tmp_path_factory.mktemp("partial")
    scenario = write(folder / "short.toml", SHORT)
    done = nrs("run", scenario, "-o", folder / "run.mcap", "--compression", "none")
    assert done.returncode == 0, done.stderr
    with Reader(folder / "run.mcap") as reader:
        writer = Writer(
            folder / "whole.mcap",
            version="test",
            channels=reader.channels,
            schemas=reader.schemas,
            metadata={
                name: fields
                for name, fields in reader.metadata.items()
                if name not in {"nrs.begin", "nrs.end"}
            },
            attachments=reader.attachments,
            chunk_bytes=1,
            compression="none",
        )
        with writer:
            messages = [*reader.messages()]
            for k in range(reader.ticks + 1):
                writer.write(message for message in messages if message[2] == k)
            writer.finish("completed")
    return folder / "whole.mcap"


def chunks(path):
    """Return where each chunk begins, as the reader found them."""
    with Reader(path) as reader:
        return [span.offset for span in reader._chunks]


def flipped_in(path, into, number):
    """Flip a bit of a message in one chunk."""
    data = bytearray(path.read_bytes())
    data[chunks(path)[number] + 300] ^= 1
    into.write_bytes(data)
    return into


def count(path, keep):
    with Reader(path) as reader:
        return sum(1 for message in reader.messages() if keep(message[2]))


@pytest.mark.parametrize("agents", [(), ("--agents-only",)])
class TestVerify:
    def test_a_whole_recording_is_identical(self, whole, agents):
        done = nrs("replay", whole, "--verify", *agents)
        assert done.returncode == 0
        assert f"the same {count(whole, lambda _: True)} messages" in done.stdout
        assert ("efforts in them are taken from the recording" in done.stdout) == bool(agents)
        assert ("agents and plants, run again" in done.stdout) != bool(agents)

    def test_with_a_damaged_first_tick_nothing_is_verified(self, whole, agents, tmp_path):
        path = flipped_in(whole, tmp_path / "a.mcap", 0)
        done = nrs("replay", path, "--verify", *agents)
        later, first = count(whole, lambda k: k > 0), count(whole, lambda k: k == 0)
        assert done.returncode == 1
        said = " ".join(done.stderr.split())
        assert "no message could be looked at: tick 0 is not here" in said
        assert f"{later} that are here could not be looked at" in said
        assert f"{first} that the run had are not here" in said
        assert "identical" not in done.stdout + done.stderr

    def test_a_damaged_middle_is_verified_up_to_it(self, whole, agents, tmp_path):
        path = flipped_in(whole, tmp_path / "a.mcap", 6)
        done = nrs("replay", path, "--verify", *agents)
        before, later = count(whole, lambda k: k < 6), count(whole, lambda k: k > 6)
        assert done.returncode == 1
        said = " ".join(done.stderr.split())
        assert f"give the same {before} messages" in said
        assert ", to the last bit, in ticks 0 to 5; " in said
        assert f"{later} that are here could not be looked at" in said
        assert "identical" not in done.stdout + done.stderr

    def test_a_recovered_gap_is_not_verified_either(self, whole, agents, tmp_path):
        damaged = flipped_in(whole, tmp_path / "a.mcap", 6)
        assert nrs("recover", damaged, "-o", tmp_path / "b.mcap").returncode == 0
        done = nrs("replay", tmp_path / "b.mcap", "--verify", *agents)
        assert done.returncode == 1
        assert "could not be looked at" in " ".join(done.stderr.split())

    def test_a_cut_end_is_verified_up_to_it(self, whole, agents, tmp_path):
        (tmp_path / "a.mcap").write_bytes(whole.read_bytes()[: chunks(whole)[8]])
        done = nrs("replay", tmp_path / "a.mcap", "--verify", *agents)
        assert done.returncode == 1
        said = " ".join(done.stderr.split())
        assert "in ticks 0 to 7; how many the run had beside these is not known" in said


class TestDiff:
    def both(self, a, b):
        info = json.loads(nrs("diff", a, b, "--json").stdout)
        done = nrs("diff", a, b)
        assert done.returncode == (0 if info["same"] else 1)
        return info, " ".join((done.stdout + done.stderr).split())

    def test_recordings_that_lack_the_same_messages_are_not_called_the_same_run(
        self, whole, tmp_path
    ):
        one, other = flipped_in(whole, tmp_path / "a.mcap", 6), tmp_path / "b.mcap"
        data = bytearray(whole.read_bytes())
        data[chunks(whole)[6] + 310] ^= 4
        other.write_bytes(data)
        info, said = self.both(one, other)
        assert (info["same"], info["first"], info["partial"]) == (False, None, ["A", "B"])
        assert "the same samples and states, to the last bit, as far as both are here" in said
        assert f"damage: {one}: " in said
        assert "the same run" not in said

    def test_an_unfinished_recording_is_compared_as_far_as_it_goes(self, whole, tmp_path):
        cut = tmp_path / "cut.mcap"
        data = whole.read_bytes()
        cut.write_bytes(data[: data.rindex(b"nrs.end", 0, data.rindex(b"nrs.end"))])
        info, said = self.both(whole, cut)
        assert (info["same"], info["first"], info["partial"]) == (False, None, ["B"])
        assert "B lacks messages of its run: they are not compared" in said

    def test_two_complete_recordings_are_the_same_run(self, whole, tmp_path):
        copy = tmp_path / "copy.mcap"
        copy.write_bytes(whole.read_bytes())
        info, said = self.both(whole, copy)
        assert (info["same"], info["partial"]) == (True, [])
        assert said.startswith("the same run: scenario, samples and states, to the last bit")


class TestDigest:
    def info(self, path):
        return json.loads(nrs("info", path, "--json").stdout)

    def test_a_complete_recording_has_the_runs_digest(self, whole):
        info = self.info(whole)
        assert info["digest"] == info["digest_here"]
        assert len(info["digest"]) == 64

    @pytest.mark.parametrize("how", ["flipped", "cut", "recovered"])
    def test_a_partial_recording_has_no_digest(self, whole, tmp_path, how):
        path = tmp_path / "a.mcap"
        if how == "cut":
            path.write_bytes(whole.read_bytes()[: chunks(whole)[8]])
        else:
            flipped_in(whole, path, 4)
        if how == "recovered":
            assert nrs("recover", path, "-o", tmp_path / "b.mcap").returncode == 0
            path = tmp_path / "b.mcap"
        info = self.info(path)
        assert info["digest"] is None
        assert info["digest_here"] not in {None, self.info(whole)["digest"]}
        text = nrs("info", path).stdout
        assert info["digest_here"] not in text
        assert "none of the run: messages of it are missing here" in text


class TestNoTick:
    @pytest.fixture
    def path(self, whole, tmp_path):
        path = tmp_path / "a.mcap"
        path.write_bytes(whole.read_bytes()[: chunks(whole)[0] + RECORD.size])
        return path

    @pytest.mark.parametrize(
        "command",
        [
            ("report", "{}", "-o", "page.html"),
            ("diff", "{}", "{whole}"),
            ("diff", "{whole}", "{}"),
            ("export", "{}", "-o", "tables"),
            ("recover", "{}", "-o", "new.mcap"),
            ("resume", "{}", "-o", "new.mcap"),
            ("scene", "{}", "-o", "new.mcap"),
            ("replay", "{}", "--publish", "--insecure-tcp"),
        ],
        ids=" ".join,
    )
    def test_every_command_reports_a_recording_without_ticks(self, path, whole, tmp_path, command):
        pytest.importorskip("foxglove_schemas_protobuf")
        words = [word.replace("{whole}", str(whole)).replace("{}", str(path)) for word in command]
        done = nrs(*words, cwd=tmp_path)
        assert done.returncode == 2
        assert "holds no tick" in done.stderr
        assert [each.name for each in tmp_path.iterdir()] == ["a.mcap"]

    @pytest.mark.parametrize("agents", [(), ("--agents-only",)])
    def test_nothing_is_verified_without_ticks(self, path, agents):
        done = nrs("replay", path, "--verify", *agents)
        assert done.returncode == 1
        assert "no message could be looked at: tick 0 is not here" in " ".join(done.stderr.split())

    def test_no_error_is_measured_without_ticks(self, path):
        info = json.loads(nrs("info", path, "--json").stdout)
        assert [row["measured"] for row in info["theory"]["quantities"]] == [None] * 4
        assert {row["status"] for row in info["theory"]["quantities"]} == {"not measured"}
        text = nrs("info", path).stdout
        assert text.count("not measured: no tick is here") == 2
        assert "inf = 0" not in text
