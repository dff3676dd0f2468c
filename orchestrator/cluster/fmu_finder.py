"""A worker finds the FMUs of a run by their content, wherever they are."""

import hashlib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from nrs_cosim.bus.keys import FMU, wire_key
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Answer
from nrs_cosim.orchestrator.cluster.missed_samples import SILENCE, AbandonedError
from nrs_cosim.orchestrator.cluster.protocol import Welcome
from nrs_cosim.plant_fmu.archives.archive import Archive, find_archive
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.cache import keep_fmu, stored_fmu
from nrs_cosim.plant_fmu.errors import FmuError


class FmuFinder:
    """Finds the FMUs of a run on a worker, by content."""

    def __init__(
        self,
        bus: ZenohBus,
        welcome: Welcome,
        folder: Path,
        signer: Signer,
        is_own: bool,
        allow_fmus: bool,
    ) -> None:
        """Find them where the scenario was, `folder`, if it `is_own`, or the user allows it."""
        self._bus, self._welcome, self._folder, self._signer = bus, welcome, folder, signer
        self._is_own, self._allow_fmus = is_own, allow_fmus

    def find(self, fmu: str) -> Archive:
        """Return the FMU that the scenario calls so, as the orchestrator has it.

        A bundled model is built. Any other is looked for in the cache; and, if the user allowed
        FMUs of the orchestrator, where the scenario says, then with the orchestrator. `FmuError`
        when it is not there.
        """
        sha256 = self._welcome.fmus.get(fmu, "")
        if fmu in bundled_models() or self._allow_fmus or self._is_own:
            with suppress(FmuError):
                archive = find_archive(fmu, self._folder)
                if archive.sha256 == sha256:
                    return archive
        path = stored_fmu(sha256) or self._fetched(fmu, sha256)
        return replace(find_archive(str(path), Path()), label=fmu)

    def _fetched(self, fmu: str, sha256: str) -> Path:
        if self._is_own:
            raise FmuError(f"{fmu}: is gone, or is no more what it was when the run began")
        if not self._allow_fmus:
            raise FmuError(
                f"{fmu}: this worker has no FMU of SHA-256 {sha256[:16]}… in its cache; "
                "--allow-fmus lets it run the orchestrator's, and those at paths that the scenario "
                "names"
            )
        inbox, key = self._bus.listen(), wire_key(FMU, sha256)
        self._bus.ask(key, self._signer.sign(key, b""), inbox)
        while True:
            for item in inbox.take(SILENCE):
                if isinstance(item, Answer):
                    if item.payload is None:
                        raise AbandonedError("the orchestrator is gone")
                    if not item.payload:
                        raise FmuError(f"{fmu}: the orchestrator cannot read it any more")
                    if hashlib.sha256(item.payload).hexdigest() == sha256:
                        return keep_fmu(item.payload, sha256)
