"""How each command ends: 0 done, 1 it failed or does not hold, 2 bad input, 130 interrupted."""

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from nrs_cosim.orchestrator.cli.main import command as command_line
from tests.command import nrs
from tests.guard import GUARD
from tests.plant_fmu.rewritten_fmus import rewritten, sources_alone
from tests.recordings import made_up_runs
from tests.scenarios import PAPER, SHORT, tables, toml, write

NRS = Path(sys.executable).with_name("nrs")
SLIDER = """
<robot name="slider"><link name="rail"/>
  <link name="cart"><inertial><mass value="2"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/>
    <axis xyz="1 0 0"/><limit effort="1" velocity="1"/></joint></robot>
"""
FAMILY = command_line()


def leaves(group=FAMILY, words=()):
    """Yield the words of each command that is no group of others."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from leaves(command, (*words, name))
        else:
            yield (*words, name)


COMMANDS = [" ".join(words) for words in leaves()]

STATUSES = {
    0: [
        "--version",
        "run good.toml -o new.mcap",
        "resume cut.mcap -o new.mcap",
        "replay whole.mcap --verify",
        "replay whole.mcap --algorithm beta=1.0 -o new.mcap",
        "diff whole.mcap whole.mcap",
        "report whole.mcap -o new.html",
        "convert whole.mcap --to ros2 -o new --robots 2 --from 0.1 --until 0.2 --epoch 7",
        "convert cut.mcap --to ros2 -o new.mcap",
        "info whole.mcap",
        "info cut.mcap",
        "export whole.mcap -o new",
        "recover cut.mcap -o new.mcap",
        "scene whole.mcap -o new.mcap",
        "check good.toml",
        "check wild.toml",
        "check good.toml --strict",
        "check lossy.toml --strict",
        "check good.toml --strict --json",
        "design good.toml --fastest",
        "sweep good.toml --over run.seed=1,2 --jobs 0 -o new",
        "study info study",
        "study report study -o new.html",
        "study run study '' -o new.mcap",
        "study merge study -o new",
        "doctor",
        "schema",
        "schema --messages -o new",
        "fmu list",
        "fmu info two_link_arm",
        "fmu check planar_robot",
        "fmu build two_link_arm -o new.fmu",
        "fmu agent good.toml --robot 1 -o new.fmu",
        "fmu compile sources.fmu -o new.fmu",
        "export whole.mcap --to ssp -o new.ssp",
        "fmu from-urdf slider.urdf -o new.fmu --gravity 0,0,0",
    ],
    1: [
        "run wild.toml -o new.mcap",
        "resume wild.mcap -o new.mcap",
        "replay whole.mcap --algorithm alpha=90 -o new.mcap",
        "replay cut.mcap --verify",
        "diff whole.mcap other.mcap",
        "diff whole.mcap cut.mcap",
        "check wild.toml --strict",
        "check wild.toml --strict --json",
        "check lying.toml --strict",
        "check stranger.toml --strict",
        "doctor --listen tls/127.0.0.1:7447",
        "fmu check renamed.fmu",
        "worker --insecure-tcp --connect unixsock-stream//nobody --wait 0.5",
    ],
    2: [
        "",
        "fmu",
        "frobnicate",
        "--frobnicate",
        *COMMANDS[: COMMANDS.index("doctor")],  # which want an argument
        *(f"{command} --frobnicate" for command in COMMANDS),
        "run none.toml",
        "run bad.toml",
        "run whole.mcap",
        "run good.toml --workers 9",
        "run good.toml -o whole.mcap",
        "run good.toml --compression rar",
        "resume none.mcap",
        "resume whole.mcap",
        "replay none.mcap --verify",
        "replay whole.mcap",
        "replay whole.mcap --algorithm gamma=1",
        "replay whole.mcap --verify --foxglove",
        "replay whole.mcap --foxglove --from 9",
        "replay whole.mcap --publish --ros2 --domain 233",
        "replay long.mcap --publish --ros2 --insecure-tcp --epoch 2147483647",
        "diff whole.mcap none.mcap",
        "diff whole.mcap good.toml",
        "report none.mcap -o new.html",
        "report whole.mcap -o new.odt",
        "convert whole.mcap -o new.mcap",
        "convert whole.mcap --to odt -o new.mcap",
        "convert whole.mcap --to ros2 -o new.csv",
        "convert whole.mcap --to ros2 -o good.toml",
        "convert whole.mcap --to ros2 -o study",
        "convert whole.mcap --to ros2 -o new --robots 1-3",
        "convert whole.mcap --to ros2 -o new --from 1",
        "convert whole.mcap --to ros2 -o new --epoch 2147483648",
        "convert long.mcap --to ros2 -o new --epoch 2147483647",
        "convert none.mcap --to ros2 -o new.mcap",
        "info none.mcap",
        "info good.toml",
        "info .",
        "export none.mcap -o new",
        "export whole.mcap -o new --format odt",
        "recover none.mcap -o new.mcap",
        "recover cut.mcap -o cut.mcap",
        "scene none.mcap -o new.mcap",
        "check none.toml",
        "check bad.toml",
        "check bad.toml --strict",
        "design good.toml --accuracy -1 1",
        "doctor --listen 7447",
        "schema more",
        "schema --messages",
        "schema -o new",
        "schema --messages -o good.toml",
        "fmu list more",
        "fmu info none",
        "fmu check none.fmu",
        "fmu check planar_robot --scenario none.toml",
        "fmu check planar_robot --variables q=3",
        'fmu check planar_robot --variables qq="q"',
        "fmu build none -o new.fmu",
        "fmu agent good.toml --robot 4 -o new.fmu",
        "fmu compile none.fmu -o new.fmu",
        "fmu agent lossy.toml --robot 1 -o new.fmu",
        "export whole.mcap --to ssp -o new.csv",
        "fmu build two_link_arm -o new.fmu --fmi 4",
        "fmu build two_link_arm -o new.fmu --platform linux65",
        "fmu build two_link_arm -o new.fmu --platform aarch64-linux --fmi 2",
        "fmu from-urdf none.urdf -o new.fmu",
        "fmu from-urdf slider.urdf -o new.fmu --gravity 1,2",
        "worker --connect 7447",
        "worker --insecure-tcp --connect tcp/127.0.0.1:1 --robots x",
    ],
}
ROWS = [(status, line) for status, lines in STATUSES.items() for line in lines]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with scenarios, recordings and models, good and bad."""
    folder = tmp_path_factory.mktemp("statuses")
    good = tables({"run.divergence_limit": 1000.0}, base=made_up_runs.chain(2, 2, 3))
    stranger = rewritten(folder / "stranger.fmu", 3, lambda text: text + "<!-- of others -->")
    for name, base, change in (
        ("good", good, {}),
        ("other", good, {"run.seed": 2}),
        ("wild", "paper_example_1c", {"run.divergence_limit": 500.0}),
        ("lossy", good, {"faults.links": [{"loss": 0.5}]}),
        ("lying", good, {"faults.byzantine": [{"robot": 1, "kind": "offset", "value": 1.0}]}),
        ("stranger", good, {"plant.fmu": stranger.name, "controller.kp": 0.001}),
        ("bad", good, {"plant": None, "plnt": good["plant"]}),
        ("long", PAPER, SHORT),
    ):
        write(folder / f"{name}.toml", change, base=base)
    (folder / "slider.urdf").write_text(SLIDER, "utf-8")
    sources_alone(folder / "sources.fmu", 2)
    rewritten(folder / "renamed.fmu", 3, lambda text: text.replace('"q"', '"theta"'))
    for name, status in (("other", 0), ("wild", 1), ("long", 0)):
        done = nrs("run", f"{name}.toml", "-o", f"{name}.mcap", cwd=folder)
        assert done.returncode == status, done.stderr
    assert nrs("run", "good.toml", "-o", "whole.mcap", cwd=folder).returncode == 0
    studied = nrs("sweep", "good.toml", "--seeds", "1", "--jobs", "0", "-o", "study", cwd=folder)
    assert studied.returncode == 0, studied.stderr
    whole = (folder / "long.mcap").read_bytes()
    cut = whole.rindex(b"nrs.end", 0, whole.rindex(b"nrs.end"))
    (folder / "cut.mcap").write_bytes(whole[:cut])
    return folder


@pytest.mark.parametrize(("status", "line"), ROWS, ids=[f"{s} {line}" for s, line in ROWS])
def test_each_command_line_ends_with_its_exit_status(folder, tmp_path, status, line):
    new = tmp_path / "new"
    words = [str(new) + w[3:] if w.startswith("new") else w for w in shlex.split(line)]
    done = nrs(*words, cwd=folder)
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    if status and line not in {"", "fmu"}:  # which show what commands there are
        assert done.stderr or status == 1
    if status == 2:
        assert not any(tmp_path.iterdir())


def test_each_command_is_tested_with_success_and_failure():
    def exits(status):
        return {
            command for command in COMMANDS for line in STATUSES[status] if line.startswith(command)
        }

    assert exits(2) == set(COMMANDS)
    assert exits(0) == {*COMMANDS} - {"worker"}  # which ends well with the run that it joins


@pytest.mark.parametrize("command", ["", *COMMANDS, "fmu"])
@pytest.mark.parametrize("option", ["-h", "--help"])
def test_help_has_a_short_and_a_long_option(command, option):
    shown = nrs(*command.split(), option)
    assert (shown.returncode, shown.stderr) == (0, "")
    assert shown.stdout.lstrip().startswith(f"Usage: nrs {command}".rstrip())


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_reports_an_interrupt(command, monkeypatch):
    *words, name = command.split()
    group = FAMILY
    for word in words:
        group = group.commands[word]

    def interrupted(_ctx):
        raise KeyboardInterrupt

    monkeypatch.setattr(group.commands[name], "invoke", interrupted)
    monkeypatch.setattr(group.commands[name], "parse_args", lambda _ctx, _args: [])
    done = nrs(*command.split())
    assert (done.returncode, done.stderr) == (130, "interrupted: by the user\n")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_termination_signal_is_an_interrupt(tmp_path, number):
    """The scenario is a pipe: once it is opened, the command waits for what comes through."""
    pipe = tmp_path / "s.toml"
    os.mkfifo(pipe)
    process = subprocess.Popen(
        [NRS, "check", pipe], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with pipe.open("wb"):
        process.send_signal(number)
        printed = process.communicate(timeout=GUARD)
    assert (process.returncode, *printed) == (130, "", "interrupted: by the user\n")


def test_a_run_under_nohup_survives_the_terminal(tmp_path):
    """As `nohup` has it."""
    pipe = tmp_path / "s.toml"
    os.mkfifo(pipe)
    process = subprocess.Popen(
        ["/bin/sh", "-c", 'trap "" HUP; exec "$0" check "$1"', NRS, pipe],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with pipe.open("w") as scenario:
        process.send_signal(signal.SIGHUP)
        scenario.write(toml(base=made_up_runs.chain(2, 2, 3)))
    printed = process.communicate(timeout=GUARD)
    assert process.returncode == 0, printed[1]
    assert "the estimates converge" in printed[0]


def test_strict_lists_violated_and_unknown_conditions(folder):
    wild = nrs("check", "wild.toml", "--strict", cwd=folder).stderr.splitlines()
    assert [line.split("(")[0].split(":")[1].strip() for line in wild] == [
        "alpha",
        "beta",
        "convergence is violated",
    ]
    lying = nrs("check", "lying.toml", "--strict", cwd=folder).stderr.splitlines()
    assert lying[-1].startswith("strict: convergence is unknown: ")
