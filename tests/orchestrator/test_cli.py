"""The command `nrs` as a user has it: exit status, messages, JSON fields, CSV columns."""

import csv
import json
import os
import pty
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from nrs_cosim.bus.keys import kind_of
from nrs_cosim.orchestrator.cli import terminal_run
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.guard import GUARD
from tests.scenarios import PAPER_FILE, SCENARIOS, SHORT, tables, toml, write
from tests.topics import node_of

NRS = Path(sys.executable).with_name("nrs")


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return the recording of one second of the paper's example, made by the command."""
    folder = tmp_path_factory.mktemp("cli")
    scenario = write(folder / "short.toml", SHORT)
    command = [NRS, "run", scenario, "-o", folder / "short.mcap"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "short.mcap", done.stdout


def test_run_ends_with_a_summary(recording):
    path, printed = recording
    lines = dict(line.split(None, 1) for line in printed.splitlines())
    assert lines["run"] == "short: completed"
    assert lines["ticks"].startswith("10 of 10, t = 1 s in ")
    assert lines["messages"].startswith("376")
    assert re.fullmatch("[0-9a-f]{64}", lines["digest"])
    assert lines["recording"] == str(path)
    assert lines["plants"].startswith(
        "two_link_arm (FMI 3.0, reference-driven Co-Simulation, 6 robots)"
    )
    assert "sup |eps - eps_0|inf = " in lines["estimates"]


def test_info_as_json_has_the_documented_fields(recording):
    path, printed = recording
    result = json.loads(nrs("info", path, "--json").stdout)
    assert result.keys() >= {
        "status", "reason", "digest", "ticks", "robots", "messages", "duration", "scenario",
        "plants", "versions",
    }  # fmt: skip
    assert (result["status"], result["reason"], result["ticks"]) == ("completed", "", 10)
    assert (result["robots"], result["messages"], result["duration"]) == (6, 376, 1.0)
    assert result["digest"] in printed
    (plant,) = result["plants"]
    assert (plant["name"], plant["fmi_version"], plant["kind"]) == (
        "two_link_arm",
        "3.0",
        "CoSimulation",
    )
    assert re.fullmatch("[0-9a-f]{64}", plant["sha256"])
    assert "sampling_period = 0.1" in result["scenario"]


def test_info_of_a_cut_recording_shows_the_damage_and_exits_0(recording, tmp_path):
    cut = tmp_path / "cut.mcap"
    whole = recording[0].read_bytes()
    cut.write_bytes(whole[: whole.index(b"nrs.end")])
    done = nrs("info", cut, "--json")
    result = json.loads(done.stdout)
    assert done.returncode == 0
    assert result["status"] == "unfinished"
    assert result["damage"]
    assert nrs("info", cut).returncode == 0


def test_info_of_a_file_that_is_no_recording_exits_2(tmp_path):
    (tmp_path / "text.mcap").write_text("no recording")
    for path in (tmp_path / "text.mcap", tmp_path / "none.mcap", tmp_path):
        done = nrs("info", path)
        assert done.returncode == 2
        assert str(path) in done.stderr
        assert "Traceback" not in done.stderr


def test_other_readers_decode_every_message(recording):
    """The reference reader and protobuf's decoder see the numbers that our tables show."""
    path, _ = recording
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        decoded = list(reader.iter_decoded_messages())
        attachment = next(iter(reader.iter_attachments()))
    assert len(decoded) == 376
    assert attachment.name == "scenario.toml"
    for schema, channel, message, value in decoded:
        kind, number = kind_of(channel.topic), node_of(channel.topic)
        assert schema.name == {"sample": "nrs.Sample", "state": "nrs.State"}[kind]
        assert (value.robot, value.k, value.time_ns) == (
            number, message.sequence, message.log_time,
        )  # fmt: skip


def test_export_writes_tables_that_read_back_to_the_same_bits(recording, tmp_path):
    path, _ = recording
    done = nrs("export", path, "-o", tmp_path / "tables")
    assert done.returncode == 0
    with path.open("rb") as file:
        decoded = list(
            make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages()
        )
    joints = ["position", "velocity", "effort", "reference_position", "reference_velocity"]
    for name, vectors in (("sample", ["position", "velocity"]), ("state", joints)):
        with (tmp_path / "tables" / f"{name}s.csv").open(newline="") as file:
            columns, *rows = csv.reader(file)
        assert columns == ["k", "time_ns", "t", "robot"] + [
            f"{v}_{i}" for v in vectors for i in (1, 2)
        ]
        values = [value for _, channel, _, value in decoded if kind_of(channel.topic) == name]
        expected = sorted(
            [
                v.k,
                v.time_ns,
                v.time_ns / 1e9,
                v.robot,
                *(x for vector in vectors for x in getattr(v, vector)),
            ]
            for v in values
        )
        assert [[float(x) for x in row] for row in rows] == expected


def test_check_as_json_has_the_documented_fields():
    result = json.loads(nrs("check", SCENARIOS / "paper_example_3a.toml", "--json").stdout)
    assert result["spanning_tree"] is True
    assert result["h_bound"] == pytest.approx(0.493769, abs=5e-7)
    assert result["alpha_beta_bound"] == pytest.approx(1.171573, abs=5e-7)
    assert result["spectral_radius"] == pytest.approx(0.883173, abs=5e-7)
    assert sorted(result["spectrum"]) == [
        [pytest.approx(-(0.5**0.5)), 0], [0, 0], [0, 0], [0, 0], [0, 0],
        [pytest.approx(0.5**0.5), 0],
    ]  # fmt: skip
    for condition in result["conditions"]:
        value, bound, margin = (condition[name] for name in ("value", "bound", "margin"))
        assert margin == (value - bound if condition["relation"] == ">" else bound - value)
        assert condition["status"] == ("holds" if margin > 0 else "violated")
    first = json.loads(nrs("check", PAPER_FILE, "--json").stdout)
    assert first["h_bound"] is None


def test_the_recorded_scenario_text_is_verbatim(tmp_path):
    text = toml(SHORT) + "# :key: [red] \u00e4\n"
    (tmp_path / "a*b#c.toml").write_text(text, "utf-8")
    assert nrs("run", tmp_path / "a*b#c.toml", "-o", tmp_path / "s.mcap").returncode == 0
    assert json.loads(nrs("info", tmp_path / "s.mcap", "--json").stdout)["scenario"] == text


def test_a_bound_too_large_for_a_number_is_null(tmp_path):
    scenario = write(tmp_path / "s.toml", {"algorithm.alpha": 1e-320}, base="paper_example_3a")
    done = nrs("check", scenario, "--json")
    assert done.stderr == ""
    assert json.loads(done.stdout, parse_constant=pytest.fail)["h_bound"] is None


def test_check_outside_the_bound_reports_divergence():
    result = nrs("check", SCENARIOS / "paper_example_1c.toml")
    assert result.returncode == 0
    assert "the estimates diverge" in result.stdout
    assert "1.171573" in result.stdout
    assert "fails" in result.stdout


def test_run_outside_the_bound_warns_with_the_gain(tmp_path):
    scenario = write(tmp_path / "s.toml", SHORT, base="paper_example_1c")
    done = nrs("run", scenario, "-o", tmp_path / "s.mcap")
    assert done.returncode == 0
    assert "warning: alpha = 1.18 is outside (0, 1.17157), the bound of Theorem 1" in done.stderr


def test_a_run_that_fails_exits_1_with_a_valid_recording(tmp_path):
    limit = {"run.divergence_limit": 500.0}
    scenario = write(tmp_path / "s.toml", limit, base="paper_example_1c")
    done = nrs("run", scenario, "-o", tmp_path / "s.mcap")
    assert done.returncode == 1
    assert "failed: diverged at t = " in done.stderr
    result = json.loads(nrs("info", tmp_path / "s.mcap", "--json").stdout)
    assert result["status"] == "failed"
    assert result["reason"] in done.stderr.replace("\n", " ")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"plant.fmu": "two_link_am"}, "did you mean 'two_link_arm'?"),
        ({"plant.fmu": "none.fmu"}, "none.fmu: no such FMU in /"),
        ({"plant.parameters": {"mm1": 1}}, "'mm1'"),
        (
            {"plant.parameters": {"m1": [1, 2]}},
            "m1 takes 1",
        ),
        ({"run.sampling_period": 0}, "run.sampling_period: expected greater"),
        ({"plant": None, "plnt": {"fmu": "two_link_arm"}}, "did you mean 'plant'?"),
        (
            {"plant.variables": {"tau_applied": "tau"}},
            "plant: two_link_arm: tau and tau_applied stand for the same number",
        ),
        ({"algorithm.name": "dcea0"}, "algorithm.name: expected one of dcea1, dcea2"),
    ],
)
def test_bad_input_exits_2_without_a_file_or_a_traceback(tmp_path, change, message):
    done = nrs("run", write(tmp_path / "s.toml", change), "-o", tmp_path / "s.mcap")
    assert done.returncode == 2
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "s.mcap").exists()


@pytest.mark.parametrize("command", ["check", "run"])
def test_a_target_of_more_axes_than_the_plant_names_the_file(tmp_path, command):
    axes = [{}, *tables()["target"]["axes"]]
    scenario = write(tmp_path / "s.toml", {"target.axes": axes, "disturbance": None})
    done = nrs(command, scenario, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        f"error: {scenario}: plant: two_link_arm: q takes 3 numbers here, one for each of the "
        "scenario's target.axes, but the FMU has 2: q\n"
    )


@pytest.mark.parametrize("restarts", [0, 1])
def test_a_profile_counts_the_time_of_a_dead_worker_as_other(tmp_path, monkeypatch, restarts):
    real = terminal_run.run_scenario

    def run(*given, **options):
        return replace(real(*given, **options), restarts=restarts)

    monkeypatch.setattr(terminal_run, "run_scenario", run)
    scenario = write(tmp_path / "s.toml", SHORT)
    done = nrs("run", scenario, "-o", tmp_path / "s.mcap", "--profile")
    result = "profile: what a worker did before it was gone is under other\n"
    assert (done.returncode, done.stderr) == (0, result * restarts)


def test_wrong_options_exit_2():
    for arguments in (
        ("run",),
        ("run", PAPER_FILE, "--frobnicate"),
        ("frobnicate",),
        ("run", PAPER_FILE, "--compression", "rar"),
        ("fmu", "build", "two_link_arm"),
    ):
        done = nrs(*arguments)
        assert done.returncode == 2, arguments
        assert "Traceback" not in done.stderr


def test_an_output_that_is_a_folder_exits_2(tmp_path):
    done = nrs("run", PAPER_FILE, "-o", tmp_path)
    assert done.returncode == 2
    assert str(tmp_path) in done.stderr


def test_a_run_overwrites_only_recordings(tmp_path):
    scenario = write(tmp_path / "s.toml", SHORT)
    text = scenario.read_text("utf-8")
    (tmp_path / "thesis").write_text(text, "utf-8")
    for output, result in ((scenario, "is the name of a scenario"), ("thesis", "is no recording")):
        done = nrs("run", scenario, "-o", tmp_path / output)
        assert done.returncode == 2
        assert result in done.stderr
    assert scenario.read_text("utf-8") == text
    assert nrs("run", scenario, "-o", "/dev/null").returncode == 2
    for force in ((), ("--force",)):
        assert nrs("run", scenario, "-o", tmp_path / "s.mcap", *force).returncode == 0


def test_runs_started_together_get_separate_files(tmp_path):
    write(tmp_path / "s.toml", SHORT)
    together = [
        subprocess.Popen([NRS, "run", "s.toml"], cwd=tmp_path, stdout=subprocess.DEVNULL)
        for _ in range(3)
    ]
    assert [process.wait(GUARD) for process in together] == [0, 0, 0]
    files = list((tmp_path / "recordings" / "data").iterdir())
    assert len(files) == 3
    assert all(json.loads(nrs("info", f, "--json").stdout)["ticks"] == 10 for f in files)


def test_a_run_that_cannot_start_leaves_no_file(tmp_path):
    write(tmp_path / "s.toml", {"plant.fmu": "no_such_arm"})
    assert nrs("run", "s.toml", cwd=tmp_path).returncode == 2
    assert list((tmp_path / "recordings" / "data").iterdir()) == []


def test_a_closed_output_pipe_is_not_a_failure():
    process = subprocess.Popen([NRS, "schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait(GUARD) == 0
    process.stderr.close()


def test_check_finds_the_errors_that_run_finds(tmp_path):
    for change, message in (
        ({"plant.fmu": "two_link_am"}, "did you mean 'two_link_arm'?"),
        ({"controller.kp": [[1.0, 3.0], [3.0, 1.0]]}, None),
    ):
        done = nrs("check", write(tmp_path / "s.toml", change))
        assert done.returncode == (2 if message else 0)
        assert message is None or message in done.stderr
    assert re.search(r"kp +-2 +> 0.000000 +-2.000000 +fails", done.stdout)


def test_schema_is_json():
    assert json.loads(nrs("schema").stdout)["properties"].keys() >= {"run", "network", "robots"}


def test_fmu_list_info_and_build(tmp_path):
    assert [line.split()[0] for line in nrs("fmu", "list").stdout.splitlines()] == [
        "n_link_arm",
        "planar_robot",
        "two_link_arm",
    ]
    for fmi, version in ((2, "2.0"), (3, "3.0")):
        path = tmp_path / f"arm{fmi}.fmu"
        assert nrs("fmu", "build", "two_link_arm", "-o", path, "--fmi", fmi).returncode == 0
        result = json.loads(nrs("fmu", "info", path, "--json").stdout)
        assert (result["name"], result["fmi_version"]) == ("two_link_arm", version)
        assert result["kinds"] == ["CoSimulation", "ModelExchange"]


def test_fmi_2_and_3_give_the_same_run(recording, tmp_path):
    """The digest counts states and samples alone, and one core computes both."""
    assert (
        nrs("fmu", "build", "two_link_arm", "-o", tmp_path / "arm.fmu", "--fmi", 2).returncode == 0
    )
    scenario = write(tmp_path / "s.toml", SHORT, {"plant.fmu": "arm.fmu"})
    done = nrs("run", scenario, "-o", tmp_path / "s.mcap")
    assert done.returncode == 0, done.stderr
    with Reader(recording[0]) as three, Reader(tmp_path / "s.mcap") as two:
        assert two.digest == three.digest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_ctrl_c_in_a_terminal_closes_the_recording(tmp_path, number):
    """A real terminal, a real signal: the progress bar shows, the file is valid, 130."""
    write(tmp_path / "long.toml", {"run.duration": 36000.0})
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [NRS, "run", tmp_path / "long.toml", "-o", tmp_path / "long.mcap"],
        stdin=slave, stdout=slave, stderr=slave, start_new_session=True,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "120"},
    )  # fmt: skip
    os.close(slave)
    seen = b""
    while b"x real time" not in seen:
        seen += os.read(master, 4096)
    os.killpg(process.pid, number)
    while True:
        try:
            chunk = os.read(master, 4096)
        except OSError:  # the terminal's other end is closed
            break
        seen += chunk
    assert process.wait(GUARD) == 130
    os.close(master)
    assert b"of 36000 s" in seen
    result = json.loads(nrs("info", tmp_path / "long.mcap", "--json").stdout)
    assert result["status"] == "interrupted"
    assert result["reason"] == f"stopped by the user after t = {result['duration']:g} s"
    assert result["damage"] == []
    assert result["ticks"] > 0


def test_a_cut_recording_is_recovered_with_its_reason(recording, tmp_path):
    cut, new = tmp_path / "cut.mcap", tmp_path / "new.mcap"
    whole = recording[0].read_bytes()
    cut.write_bytes(whole[: whole.rindex(b"nrs.end", 0, whole.rindex(b"nrs.end"))])
    done = nrs("recover", cut, "-o", new)
    assert done.returncode == 0, done.stderr
    assert "damage: the file ends inside a record" in done.stderr
    result = json.loads(nrs("info", new, "--json").stdout)
    assert (result["status"], result["ticks"], result["damage"]) == ("failed", 10, [])
    assert result["reason"].startswith(f"recovered from {cut.name}: unfinished; never closed")
    assert result["digest"] is None
    assert result["digest_here"] in recording[1]
    for target in (new, cut):
        done = nrs("recover", cut, "-o", target)
        assert done.returncode == 2
        assert f"{target}: is there already" in done.stderr


def test_export_writes_parquet_and_refuses_unknown_formats(recording, tmp_path):
    done = nrs("export", recording[0], "-o", tmp_path, "--format", "parquet")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(tmp_path / f"{t}.parquet") for t in ("samples", "states")]
    done = nrs("export", recording[0], "-o", tmp_path, "--format", "odt")
    assert done.returncode == 2
    assert "'odt'" in done.stderr


def test_scene_keeps_the_digest(recording, tmp_path):
    new = tmp_path / "scene.mcap"
    done = nrs("scene", recording[0], "-o", new)
    assert done.stdout == f"{new}\n"
    assert "import it in Foxglove" in done.stderr
    assert done.returncode == 0
    result = json.loads(nrs("info", new, "--json").stdout)
    assert (result["status"], result["ticks"]) == ("completed", 10)
    assert result["digest"] in recording[1]
    assert result["messages"] > 376
    assert nrs("scene", recording[0], "-o", new).returncode == 2
