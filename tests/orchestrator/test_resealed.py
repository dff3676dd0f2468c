"""A recording that was changed and sealed again is refused in one line, or is not the worse for it.

Whoever has the sources can write any record with right seals. Each field of each record is taken
away or given other values; every command must name the file, or answer as for the recording as it
was.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import pytest

from nrs_cosim.recordings.mcap import writer as writer_module
from nrs_cosim.recordings.mcap.container import BEGIN, END, tail
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import PARENT, RUN, SCENARIO, VERSIONS
from tests.cases import cases
from tests.command import nrs
from tests.recordings import made_up_runs
from tests.scenarios import toml, write

N, M, TICKS = 2, 2, 3
VALUES = (None, "", "x", "-1", "0", "7", "1_0", "1e3", "1" * 40, "1000000", "NaN", "[", "{}", "\0")
"""What a field becomes; None: it is taken away."""
FIELDS = {
    RUN: [
        "name",
        "folder",
        "seed",
        "robots",
        "joints",
        "ticks",
        "sampling_period_ns",
        "output_step_ns",
        "plants",
        "outputs_per_interval",
    ],
    VERSIONS: ["numpy"],
    PARENT: ["digest", "change"],
    END: [
        "status",
        "reason",
        "digest",
        "ticks",
        "messages",
        "samples",
        "spent",
        "rejected",
        "part_of",
        "measured",
        "links",
        "theory",
    ],
}
PLANT = ["fmu", "name", "fmi_version", "kind", "drive", "why", "sha256", "robots"]
FREE = {"name", "folder", "reason", "numpy", "change", "fmi_version", "kind", "drive", "why", "fmu"}
"""May be any text."""


@dataclass(frozen=True)
class Sealed:
    """A run of two robots, from which others are made."""

    path: Path

    def again(self, path, metadata=None, ending=None, scenario=None):
        """Write it anew with other records and right seals."""
        with Reader(self.path) as reader:
            kept = {n: dict(f) for n, f in reader.metadata.items() if n != BEGIN}
            writer_of = {
                "version": "test",
                "channels": reader.channels,
                "schemas": reader.schemas,
                "metadata": kept if metadata is None else metadata(kept),
                "attachments": dict(reader.attachments),
            }
            if scenario is not None:
                writer_of["attachments"] = scenario(writer_of["attachments"])
            kept_of_end = ("spent", "rejected", "samples", "measured", "theory")
            extra = {name: reader.end[name] for name in kept_of_end if name in reader.end}
            changed = ending or (lambda fields: fields)

            def other(*, fields, **transient):
                return tail(fields=changed(dict(fields)), **transient)

            with (
                patch.object(writer_module, "tail", other),
                writer_module.Writer(path, **writer_of) as writer,
            ):
                for batch in reader.batches():
                    writer.write(batch)
                writer.finish("completed", "", extra)
        return path


@pytest.fixture(scope="module")
def sealed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sealed")
    write(folder / "two.toml", base=made_up_runs.chain(N, M, TICKS))
    assert nrs("run", folder / "two.toml", "-o", folder / "run.mcap").returncode == 0
    change = ("replay", folder / "run.mcap", "--algorithm", "beta=1.0")
    assert nrs(*change, "-o", folder / "child.mcap").returncode == 0
    return Sealed(folder / "child.mcap")


def info(path):
    done = nrs("info", path, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def tables(path, folder):
    done = nrs("export", path, "-o", folder)
    return done, [(folder / name).read_bytes() for name in ("samples.csv", "states.csv")]


def expect_refused(done, path):
    assert done.returncode == 2, (done.args, done.stdout, done.stderr)
    first, *faults = done.stderr.strip().splitlines()
    assert first.startswith(f"error: {path}: ")
    assert all(line.startswith(f"{path}: {SCENARIO}: ") for line in faults)
    assert len(first) < 600


def all_commands(path, folder, other):
    """Yield what each command comes to."""
    yield nrs("info", path)
    yield nrs("info", path, "--json")
    yield nrs("export", path, "-o", folder / "tables")
    yield nrs("report", path, "-o", folder / "page.html")
    yield nrs("diff", path, other)
    yield nrs("diff", other, path)
    yield nrs("replay", path, "--verify", "--agents-only")
    yield nrs("replay", path, "--algorithm", "beta=1.1", "-o", folder / "what_if.mcap")
    yield nrs("resume", path, "-o", folder / "resumed.mcap")
    (folder / "new.mcap").unlink(missing_ok=True)
    yield nrs("recover", path, "-o", folder / "new.mcap")


def expect_no_worse(path, folder, sealed, key, commands=all_commands):
    """Every command refuses the file, or all but what was changed is as it was."""
    with_info = nrs("info", path, "--json")
    if with_info.returncode:
        for done in commands(path, folder, sealed.path):
            if done.args[1] == "diff" and done.args[2] != str(path):
                assert done.returncode == 2, (done.args, done.stdout, done.stderr)
                continue
            if done.args[1] in {"export", "recover"} and done.returncode == 0:
                continue  # which need no scenario
            if "--verify" in done.args and done.returncode == 1:
                assert key == "messages"  # which are counted again
                continue
            expect_refused(done, path)
        return False
    was, now = info(sealed.path), json.loads(with_info.stdout)
    key_of_info = "parent" if key in FIELDS[PARENT] else key
    for name in was.keys() - {"file", "theory", key_of_info}:
        if name not in {"status", "reason", "digest", "digest_here", "damage", "duration"}:
            assert now[name] == was[name] or key in [
                *PLANT,
                "numpy",
                "ticks",
                "messages",
                "samples",
            ], name
    done, found = tables(path, folder / "tables")
    assert done.returncode == 0
    assert found == tables(sealed.path, folder / "whole")[1]
    verified = nrs("replay", path, "--verify", "--agents-only")
    assert verified.returncode in {0, 1}
    assert (verified.returncode == 0) == (key not in {"digest", "messages", "ticks", "part_of"})
    return True


CHANGED = [(record, key) for record, keys in FIELDS.items() for key in keys]


@pytest.mark.parametrize(("record", "key"), cases(CHANGED, CHANGED[::3]))
def test_a_changed_record_field_is_refused_or_harmless(sealed, tmp_path, record, key):
    accepted = []
    for number, value in enumerate(VALUES):
        if value is None and key in {"outputs_per_interval", "part_of"}:
            continue  # which this run has not

        def change(fields, value=value):
            fields.pop(key, None)
            return fields if value is None else {**fields, key: value}

        def change_head(metadata, change=change):
            return {**metadata, record: change(metadata[record])}

        how = {"ending": change} if record == END else {"metadata": change_head}
        path = sealed.again(tmp_path / f"{number}.mcap", **how)
        accepted.append(expect_no_worse(path, tmp_path, sealed, key))
    assert not all(accepted) or key in FREE
    assert sum(accepted) <= 3 or key in FREE


@pytest.mark.parametrize("key", PLANT)
def test_a_changed_plant_field_is_refused_or_harmless(sealed, tmp_path, key):
    values = [None, "x", 1, float("nan"), 10**40, [], [0], [1], [1, 1], [1, 2, 3], {"a": [[]]}]
    for number, value in enumerate(values):

        def change(metadata, value=value):
            (group,) = json.loads(metadata[RUN]["plants"])
            group.pop(key)
            group |= {} if value is None else {key: value}
            return {**metadata, RUN: {**metadata[RUN], "plants": json.dumps([group])}}

        path = sealed.again(tmp_path / f"{number}.mcap", metadata=change)
        accepted = expect_no_worse(path, tmp_path, sealed, key)
        assert accepted == (value == "x" and key in FREE)


@pytest.mark.parametrize("record", [RUN, VERSIONS])
def test_a_missing_record_is_named(sealed, tmp_path, record):
    def change(metadata):
        return {name: fields for name, fields in metadata.items() if name != record}

    path = sealed.again(tmp_path / "a.mcap", metadata=change)
    for done in all_commands(path, tmp_path, sealed.path):
        if done.args[1] != "diff" and (record, done.args[1]) != (RUN, "recover"):
            assert done.returncode == 2, (done.args, done.stderr)
            assert "Traceback" not in done.stderr


def text(*changes, n=N, m=M, ticks=TICKS):
    return toml(*changes, base=made_up_runs.chain(n, m, ticks)).encode()


SCENARIOS = {
    "none": None,
    "empty": b"",
    "no text": b"\xff\xfe",
    "no TOML": b"x = [",
    "no scenario": b"x = 1",
    "nested": b"x = " + b"[" * 5000,
    "longer": text(ticks=TICKS + 1),
    "shorter": text(ticks=TICKS - 1),
    "more robots": text(n=N + 1),
    "fewer robots": text(n=N - 1),
    "more joints": text(m=M + 1),
    "another period": text({"run.sampling_period": 0.2, "run.duration": 0.6}),
    "another step": text({"run.output_step": 0.025}),
    "jitter": text({"run.sampling_jitter": 0.01}),
    "another seed": text({"run.seed": 2}),
    "inf": text({"algorithm.alpha": float("inf")}),
}


@pytest.mark.parametrize("which", SCENARIOS)
def test_a_scenario_of_another_run_is_refused(sealed, tmp_path, which):
    def change(attachments):
        kept = {name: content for name, content in attachments.items() if name != SCENARIO}
        other = SCENARIOS[which]
        return kept if other is None else kept | {SCENARIO: ("application/toml", other)}

    path = sealed.again(tmp_path / "a.mcap", scenario=change)
    assert not expect_no_worse(path, tmp_path, sealed, SCENARIO)
