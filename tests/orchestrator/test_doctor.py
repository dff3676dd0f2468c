"""The doctor finds what a run would stumble over, and says what to do."""

import json
import socket
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import PrivateFormat

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.certificate_check import vet
from nrs_cosim.orchestrator.cli.doctor import diagnose
from nrs_cosim.orchestrator.cli.option_groups import TlsOptions
from nrs_cosim.orchestrator.scenario.tables.scenario import TlsTable
from tests.command import nrs
from tests.network.authority import LONG_AGO, Authority


@pytest.fixture(scope="module")
def authority(tmp_path_factory):
    return Authority(tmp_path_factory.mktemp("authority"))


def seen(tls, now=None):
    """Return what was looked at in certificates: status and text by name."""
    return {name: (status, text) for name, status, text in vet(tls, now)}


def by_name(diagnosis):
    return {symptom.name: symptom for symptom in diagnosis.symptoms}


class TestMachine:
    def test_this_machine_passes(self, tmp_path):
        made = diagnose([f"unixsock-stream/{tmp_path}/s"], None)
        assert made.fit
        assert {s.status for s in made.symptoms} == {"ok"}
        assert [s.topic for s in made.symptoms] == [
            "plants",
            "plants",
            "bus",
            "recording",
            "listen",
        ]

    def test_a_missing_compiler_says_how_to_install_one(self, monkeypatch):
        monkeypatch.setenv("CC", "no-such-compiler")
        compiler = by_name(diagnose([], None))["compiler"]
        assert compiler.status == "fails"
        assert "CC=no-such-compiler" in compiler.text
        assert "apt install gcc" in compiler.text

    def test_a_port_in_use_fails(self):
        with socket.create_server(("127.0.0.1", 0)) as taken:
            endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
            made = diagnose([endpoint], None)
        assert not made.fit
        assert "in use; choose another port" in by_name(made)[endpoint].text

    def test_tls_without_certificates_fails(self):
        made = diagnose(["tls/127.0.0.1:7447"], None)
        assert by_name(made)["files"].status == "fails"

    def test_a_malformed_endpoint_is_bad_input(self):
        with pytest.raises(InputError, match="--listen: expected"):
            diagnose(["7447"], None)

    def test_the_command_reports_a_failed_check(self, authority):
        old = authority.issue("old", valid=LONG_AGO)
        options = {"ca": old.ca, "certificate": old.certificate, "key": old.key}
        given = [word for name, path in options.items() for word in (f"--tls-{name}", path)]
        shown = nrs("doctor", *given)
        assert (shown.returncode, shown.stderr) == (1, "")
        assert "dates               fails    expired on 2021-01-01" in shown.stdout
        result = nrs("doctor", *given, "--json")
        assert result.returncode == 1
        report = json.loads(result.stdout)
        assert not report["fit"]
        assert [s["name"] for s in report["symptoms"] if s["status"] == "fails"] == ["dates"]


class TestCertificates:
    def test_a_valid_certificate_passes(self, authority):
        found = seen(authority.issue("left", "lab.example", "192.0.2.1"))
        assert {status for status, _ in found.values()} == {"ok"}
        assert found["worker"][1].startswith("left is its name")
        assert found["addresses"][1].startswith("lab.example, 192.0.2.1")

    def test_a_certificate_of_another_authority_fails(self, authority, tmp_path):
        other = Authority(tmp_path).issue("left")
        found = seen(replace(other, ca=authority.issue("left").ca))
        assert found["signature"][0] == "fails"
        assert "is not the authority in --tls-ca" in found["signature"][1]

    @pytest.mark.parametrize(
        ("days", "status", "said"),
        [
            (-1, "fails", "not valid before 2020-01-01"),
            (1, "ok", "until 2021-01-01"),
            (340, "warning", "expires on 2021-01-01"),
            (367, "fails", "expired on 2021-01-01"),
        ],
    )
    def test_a_certificates_dates_pass_warn_or_fail(self, authority, days, status, said):
        now = datetime(2020, 1, 1, tzinfo=UTC) + timedelta(days=days)
        found = seen(authority.issue("left", valid=LONG_AGO), now)
        assert found["dates"][0] == status
        assert found["dates"][1].startswith(said)

    def test_a_name_that_no_worker_can_have(self, authority):
        assert "no worker can have it" in seen(authority.issue("orchestrator"))["worker"][1]
        status, said = seen(authority.issue("robot*"))["worker"]
        assert status == "fails"
        assert "'robot*'" in said

    def test_a_key_of_another_format_only_warns(self, authority):
        found = seen(authority.issue("left", form=PrivateFormat.TraditionalOpenSSL))
        assert found["key"][0] == "warning"
        assert "openssl pkcs8" in found["key"][1]

    def test_a_certificate_and_a_key_that_do_not_match_fail(self, authority):
        left, right = authority.issue("left"), authority.issue("right")
        found = seen(replace(left, key=right.key))
        assert list(found) == ["files"]
        assert "is not the key of the certificate" in found["files"][1]


class TestOptions:
    def test_an_option_overrides_the_scenarios_table(self):
        table = TlsTable(ca="ca.pem", certificate="c.pem", key="k.pem")
        tls = TlsOptions(tls_key=Path("own.pem")).certificates(table, Path("folder"))
        assert tls.ca == Path("folder/ca.pem")
        assert tls.key == Path("own.pem")
        assert TlsOptions().certificates() is None

    def test_certificate_options_must_be_given_together(self):
        with pytest.raises(InputError, match="--tls-certificate and --tls-key: missing"):
            TlsOptions(Path("ca.pem")).certificates()


def test_each_part_is_told_as_it_is_tried():
    begun = []
    diagnose([], None, begun.append)
    assert begun == ["the compiler", "a bundled model", "the bus", "a recording"]
