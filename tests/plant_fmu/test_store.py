"""An FMU is found by its digest alone, and only whole."""

import hashlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.plant_fmu.cache import keep_fmu, stored_fmu
from nrs_cosim.plant_fmu.errors import FmuError

DATA = np.random.default_rng(3).bytes(100_000)
SHA256 = hashlib.sha256(DATA).hexdigest()


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache that is not the user's."""
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def files(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.is_file()]


def test_a_stored_fmu_is_found(cache: Path) -> None:
    assert stored_fmu(SHA256) is None
    path = keep_fmu(DATA, SHA256)
    assert stored_fmu(SHA256) == path
    assert path.read_bytes() == DATA
    assert path.suffix == ".fmu"
    assert files(cache) == [path]


def test_content_of_another_digest_is_not_stored(cache: Path) -> None:
    with pytest.raises(
        FmuError, match=f"to have sha256 {SHA256}, but its bytes have [0-9a-f]{{64}}"
    ):
        keep_fmu(DATA[:-1], SHA256)
    assert not cache.exists()


@pytest.mark.parametrize("damage", [DATA[:-1], b"", DATA[:500] + b"\0" + DATA[501:]])
def test_a_damaged_stored_file_is_ignored_and_replaced(damage: bytes) -> None:
    path = keep_fmu(DATA, SHA256)
    path.write_bytes(damage)
    assert stored_fmu(SHA256) is None
    assert keep_fmu(DATA, SHA256) == path
    assert path.read_bytes() == DATA


def test_a_malformed_digest_leads_to_no_path(cache: Path) -> None:
    kept = keep_fmu(DATA, SHA256)
    (cache / f"{SHA256}.fmu").write_bytes(DATA)
    for name in ("", "..", f"../{SHA256}", str(kept.with_suffix("")), SHA256.upper(), "\0" * 64):
        assert stored_fmu(name) is None
    kept.unlink()
    kept.mkdir()
    assert stored_fmu(SHA256) is None


def test_concurrent_stores_do_not_interfere(cache: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        paths = set(pool.map(lambda _: keep_fmu(DATA, SHA256), range(32)))
    assert files(cache) == list(paths)
    assert stored_fmu(SHA256) in paths


def test_an_unwritable_store_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "file"))
    assert stored_fmu(SHA256) is None
    with pytest.raises(FmuError, match="set NRS_CACHE to another folder"):
        keep_fmu(DATA, SHA256)
