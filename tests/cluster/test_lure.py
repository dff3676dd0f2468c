"""An FMU whose loading alone writes a file: who names it by path does not get a worker to load
it."""

import hashlib
import subprocess
import zipfile
from pathlib import Path
from unittest.mock import Mock

import pytest
from fmpy import platform_tuple

from nrs_cosim.bus.encryption import encrypt
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.orchestrator.cluster.protocol import Hello, Welcome
from nrs_cosim.orchestrator.cluster.worker_client import JoinOptions, serve
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.archives.archive import find_archive
from tests.cluster.remote_workers import paper_file
from tests.cluster.test_content import foreign_copy
from tests.command import nrs
from tests.guard import GUARD
from tests.network.ports import free_port

RUN = "0" * 32
LURE = """
#include <stdio.h>
__attribute__((constructor)) static void loaded(void) {{
    FILE *file = fopen("{}", "w");
    if (file) fclose(file);
}}
"""


@pytest.fixture
def lure(tmp_path):
    """Return an FMU, and the file that is written when its library is loaded."""
    mark = tmp_path / "loaded"
    (tmp_path / "lure.c").write_text(LURE.format(mark))
    command = ["cc", "-shared", "-fPIC", "lure.c", "-o", "lure.so"]
    subprocess.run(command, cwd=tmp_path, check=True)
    with (
        zipfile.ZipFile(find_archive("two_link_arm", Path()).path) as ours,
        zipfile.ZipFile(tmp_path / "lure.fmu", "w") as copy,
    ):
        for entry in ours.infolist():
            is_library = entry.filename.startswith(f"binaries/{platform_tuple}")
            library = (tmp_path / "lure.so").read_bytes()
            copy.writestr(entry, library if is_library else ours.read(entry))
    return tmp_path / "lure.fmu", mark


@pytest.mark.parametrize("allow", [False, True], ids=["not allowed", "allowed"])
@pytest.mark.parametrize("relative", [False, True], ids=["absolute", "relative to its folder"])
def test_a_worker_loads_no_local_fmu_just_because_an_orchestrator_names_it(
    lure, tmp_path, allow, relative
):
    fmu, mark = lure
    named = fmu.name if relative else str(fmu)
    path = paper_file(tmp_path, 20, {"plant.fmu": named})
    meet = f"tcp/127.0.0.1:{free_port()}"
    with open_session(Endpoints(listen=(meet,), insecure_tcp=True)) as session:
        token = session.liveliness().declare_token(f"nrs/{RUN}/alive/orchestrator")

        def welcome(query):
            note = Welcome(
                run=RUN,
                secret=b"x" * 32,
                name="lure",
                scenario=path.read_text("utf-8"),
                assets={},
                folder=str(tmp_path),
                fmus={named: hashlib.sha256(fmu.read_bytes()).hexdigest()},
                robots=tuple(range(1, 7)),
            )
            public = Hello.read(query.payload.to_bytes()).public
            query.reply(query.key_expr, encrypt(public, f"{RUN}/join/left", note.written()))
            query.drop()

        def no_answer(query):
            query.reply(query.key_expr, b"")
            query.drop()

        session.declare_queryable("nrs/*/join/*", welcome)
        session.declare_queryable("nrs/*/fmu/*", no_answer)
        joining = JoinOptions("left", None, None, GUARD, allow, False, Mock())
        with pytest.raises(InputError) as rejected:
            serve(joining, Endpoints(connect=(meet,), insecure_tcp=True))
        token.undeclare()
    assert mark.exists() == (allow and not relative)
    if not allow:
        assert "has no FMU of SHA-256" in str(rejected.value)
        assert "--allow-fmus" in str(rejected.value)


@pytest.mark.parametrize(
    "command",
    [
        ("replay", "--verify"),
        ("replay", "--plant", "controller.kp=150"),
        ("replay", "--algorithm", "beta=0.9"),
        ("resume",),
    ],
    ids=" ".join,
)
def test_an_fmu_of_another_hash_than_the_recorded_one_is_not_loaded(lure, tmp_path, command):
    fmu, mark = lure
    theirs = foreign_copy(tmp_path / "arm.fmu")
    file = read_scenario(paper_file(tmp_path, 20, {"plant.fmu": "arm.fmu"}))
    recording, new = tmp_path / "run.mcap", tmp_path / "new.mcap"
    assert run(file, recording).status == "completed"
    if command == ("resume",):
        whole = recording.read_bytes()
        recording.write_bytes(whole[: whole.rindex(b"nrs.end", 0, whole.rindex(b"nrs.end"))])
    recorded = hashlib.sha256(theirs.read_bytes()).hexdigest()
    theirs.write_bytes(fmu.read_bytes())
    name, *options = command
    output = () if "--verify" in options else ("-o", new)
    done = nrs(name, recording, *options, *output)
    assert done.returncode == 2, done
    assert "is not the FMU that the recording was made with: its SHA-256 is " in done.stderr
    assert f"not {recorded}" in done.stderr
    assert "identical" not in done.stdout
    assert not mark.exists()
