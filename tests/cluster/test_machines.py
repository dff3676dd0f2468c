"""Two machines run what one process does, to the bit, over a wire that delays, loses and is cut."""

import json

import pytest

from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.cases import cases
from tests.cluster.remote_workers import NRS, PROCESS, alone, digest_of, paper_file
from tests.network.authority import Authority
from tests.network.namespaces import two_machines

TICKS, PAUSE = 200, 100
PORT = 7447


@pytest.mark.parametrize("protocol", cases(["tcp", "tls"], ["tls"]))
def test_workers_on_another_machine_give_the_same_digest_even_after_a_cut(protocol, nrs, tmp_path):
    path = paper_file(tmp_path, TICKS)
    digest = alone(read_scenario(path), tmp_path)
    with two_machines(delay_ms=5, loss_percent=1) as wire:
        meet = f"{protocol}/{wire.left.address}:{PORT}"
        own, others = {"insecure_tcp": True}, {"a": ["--insecure-tcp"], "b": ["--insecure-tcp"]}
        if protocol == "tls":
            authority = Authority(tmp_path / "tls")
            tls = authority.issue("orchestrator", wire.left.address)
            own = {
                "tls": [str(tls.ca), str(tls.certificate), str(tls.key)],
                "assignment": {"a": [1, 2, 3], "b": [4, 5, 6]},
            }
            for name in others:
                tls = authority.issue(name, wire.right.address)
                others[name] = ["--tls-ca", tls.ca, "--tls-certificate", tls.certificate]
                others[name] += ["--tls-key", tls.key]
        result = {"file": str(path), "output": str(tmp_path / "run.mcap"), "listen": [meet]}
        result |= {"pauses": [PAUSE], "expected": 2, **own}
        run = nrs(json.dumps(result), program=wire.left.command(*PROCESS))
        workers = [
            nrs(
                "worker", "--connect", meet, "--name", name, *more, program=wire.right.command(*NRS)
            )
            for name, more in others.items()
        ]
        run.until(f"paused at tick {PAUSE}")
        wire.cut()
        run.say()
        run.until("is gone, after tick")
        for worker in workers:
            worker.until("the orchestrator is gone; looking for it again")
        wire.mend()
        assert run.end()[0] == 0
        assert [worker.end()[0] for worker in workers] == [0, 0]
    assert "completed" in run.lines[-1]
    assert digest_of(tmp_path / "run.mcap") == digest
