"""Who runs a study's points: this process, processes of this machine, or a Dask cluster.

All are `concurrent.futures` executors. A cluster is others' code, run by whoever reaches its
scheduler: beyond this machine only mutual TLS is taken, and all its workers must have the versions
of what decides results. FMUs are sent to them by content, and run where a worker's user allows it.
"""

import os
from collections.abc import Mapping
from concurrent.futures import Executor
from importlib.metadata import version
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.study.dispatch import AHEAD, StudyEngine
from nrs_cosim.orchestrator.study.processes import PoolExecutor, SerialExecutor

VERSIONS = ("nrs-cosim", "numpy", "scipy")
PATIENCE = 20.0
"""s in which a scheduler answers."""


def local_engine(jobs: int | None = None) -> StudyEngine:
    """Return processes of this machine, by default as many as it has processors; 0 for none."""
    if jobs == 0:
        return StudyEngine(SerialExecutor, 1)
    count = jobs or len(os.sched_getaffinity(0))
    return StudyEngine(lambda: PoolExecutor(count), AHEAD * count)


def lent_engine(executor: Executor, jobs: int | None = None) -> StudyEngine:
    """Return an executor of the caller's, who ends it."""
    count = jobs or getattr(executor, "_max_workers", None) or len(os.sched_getaffinity(0))
    return StudyEngine(lambda: executor, AHEAD * count, lambda _executor: None)


def dask_engine(address: str, tls: Mapping[str, str] | None = None) -> StudyEngine:
    """Return the workers of a Dask scheduler at an address, such as tls://lab.example:8786.

    Raises `InputError` for one that is not there, or beyond this machine without TLS, or whose
    workers have other versions.
    """
    _expect_secure(address)
    try:
        import distributed  # noqa: PLC0415 (an extra)
    except ImportError:
        raise MissingExtraError("--dask: needs distributed", "dask") from None
    library: Any = distributed
    security = library.Security(require_encryption=True, **tls) if tls else None
    try:
        client = library.Client(address, timeout=PATIENCE, security=security, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(f"--dask {quoted(address)}: no scheduler answers: {error}") from None
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        client.close()
        raise InputError(f"--dask {quoted(address)}: the scheduler has no workers") from None
    mine = _versions()
    for worker, found in client.run(_versions).items():
        if found != mine:
            client.close()
            raise InputError(f"--dask: worker {worker} has {found}, not {mine}")
    threads = sum(client.nthreads().values())

    def close(executor: Executor) -> None:
        executor.shutdown(wait=False)
        client.close()

    return StudyEngine(lambda: client.get_executor(pure=False, retries=0), AHEAD * threads, close)


def _expect_secure(address: str) -> None:
    parts = urlsplit(address)
    host = parts.hostname or ""
    try:
        is_here = ip_address(host).is_loopback
    except ValueError:
        is_here = host == "localhost"
    if parts.scheme not in {"tcp", "tls"} or not host:
        raise InputError(f"--dask: expected tls://HOST:PORT, got {quoted(address)}")
    if parts.scheme != "tls" and not is_here:
        raise InputError(
            f"--dask {quoted(address)}: beyond this machine only tls:// is taken, for who reaches "
            "a scheduler runs what they like on its workers"
        )


def _versions() -> dict[str, str]:
    return {name: version(name) for name in VERSIONS}
