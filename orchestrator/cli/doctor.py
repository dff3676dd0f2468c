"""A machine is fit for a run when each part that a run needs has just done its work on it."""

import os
import socket
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.network.certificate_check import CertificateStatus, vet
from nrs_cosim.bus.network.certificates import Tls
from nrs_cosim.bus.network.endpoints import Address
from nrs_cosim.bus.network.sessions import try_loopback
from nrs_cosim.plant_fmu.archives.archive import find_archive
from nrs_cosim.plant_fmu.bundled.builder import try_compiler
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.recordings.channels import channels, schemas
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer

MODEL = "two_link_arm"


@dataclass(frozen=True, slots=True)
class Symptom:
    """One thing that was looked at: what was seen, or what is to be done."""

    topic: str
    name: str
    status: CertificateStatus
    text: str


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """All that was looked at."""

    symptoms: tuple[Symptom, ...]

    @property
    def fit(self) -> bool:
        """Whether nothing fails."""
        return all(symptom.status != "fails" for symptom in self.symptoms)

    def as_json(self) -> dict[str, Any]:
        """Return the symptoms for JSON."""
        return {"fit": self.fit, "symptoms": [asdict(symptom) for symptom in self.symptoms]}


def diagnose(
    listen: Sequence[str], tls: Tls | None, begin: Callable[[str], None] = lambda _: None
) -> Diagnosis:
    """Try each part; `InputError` when an endpoint to listen on is malformed.

    `begin` is called with what is tried next.
    """
    addresses = [Address.of("--listen", text) for text in listen]
    return Diagnosis(tuple(_symptoms(addresses, tls, begin)))


def _symptoms(
    addresses: Sequence[Address], tls: Tls | None, begin: Callable[[str], None]
) -> Iterator[Symptom]:
    begin("the compiler")
    yield _tried("plants", "compiler", try_compiler)
    begin("a bundled model")
    yield _tried("plants", "FMPy", _try_plant)
    begin("the bus")
    yield _tried("bus", "Zenoh", _try_bus)
    begin("a recording")
    yield _tried("recording", "MCAP", _try_recording)
    for address in addresses:
        yield _tried("listen", address.text, partial(_try_listening, address))
    if tls is not None:
        for name, status, text in vet(tls):
            yield Symptom("certificates", name, status, text)
    elif any(address.protocol == "tls" for address in addresses):
        said = "none are given; give --tls-ca, --tls-certificate and --tls-key"
        yield Symptom("certificates", "files", "fails", said)


def _tried(topic: str, name: str, trial: Callable[[], str]) -> Symptom:
    try:
        return Symptom(topic, name, "ok", trial())
    except CosimError as error:
        return Symptom(topic, name, "fails", str(error))
    except OSError as error:
        return Symptom(topic, name, "fails", f"{error.strerror or error}")


def _try_plant() -> str:
    checked = check(CheckTask(find_archive(MODEL, Path())))
    for finding in checked.findings:
        if finding.status == "fails":
            raise CosimError(f"{MODEL}: {finding.name}: {finding.text}")
    return f"{version('fmpy')} loads and steps {MODEL}"


def _try_bus() -> str:
    try_loopback()
    return f"{version('eclipse-zenoh')} talks over loopback"


def _try_recording() -> str:
    with tempfile.TemporaryDirectory(prefix="nrs-") as folder:
        path = Path(folder) / "doctor.mcap"
        codecs = Codecs.of(Sizes(1))
        topics = channels(codecs, 1, (), checkpoints=False)
        with Writer(
            path,
            version=version("nrs-cosim"),
            channels=topics,
            schemas=schemas(topics, codecs),
            metadata={},
            attachments={},
        ) as writer:
            writer.finish("completed")
        with Reader(path, verify=True) as reader:
            if reader.status != "completed" or reader.damage:
                raise CosimError(f"{path}: what was written was not read back")
        return f"a file in {Path(folder).parent} is written and read"


def _try_listening(address: Address) -> str:
    """Bind an address and let it go; nobody can connect meanwhile."""
    if address.protocol == "unixsock-stream":
        path = Path(address.host)
        if path.exists():
            raise CosimError("the file exists; remove it if no run listens there")
        if not os.access(path.parent, os.W_OK):
            raise CosimError(f"{path.parent} cannot be written")
        return "the folder can be written"
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, place = found[0]
        with socket.socket(family, kind, protocol) as trial:
            if os.name == "posix":
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(place)
    except socket.gaierror:
        raise CosimError(f"the name {address.host} is not known; give an address") from None
    except OSError as error:
        advice = "choose another port, or an address of this machine"
        raise CosimError(f"cannot be listened on: {error.strerror}; {advice}") from None
    return "can be listened on"
