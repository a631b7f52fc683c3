"""Dask clusters of campaigns, local or external."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from logs.campaigns.table import INSTALL
from logs.extras import load_extra
from wingbeat.errors import InputError

CONNECTING = 10.0
"""s; for a scheduler and its first worker to answer"""
SETTINGS = {
    # A flight whose process ends is told in its row, and not tried on every other worker.
    "distributed.scheduler.allowed-failures": 0,
    # It looks at every thread a hundred times a second, and a flight is all that a worker does.
    "distributed.worker.profile.enabled": False,
    # The last thousand messages would be kept, with all that each flight is made of in them.
    "distributed.admin.log-length": 0,
    "distributed.admin.low-level-log-length": 4,
    # Its housekeeping, fifty times a second in each process by default, is taken from the flights.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.tick.limit": "60s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "1s",
    "distributed.scheduler.work-stealing": False,
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.worker.daemon": True,
}


@contextlib.contextmanager
def local_cluster(workers: int) -> Iterator[Any]:
    """A client of ``workers`` new processes with a thread each, gone when the block ends.

    Raises:
        InputError: Dask is not installed.
    """
    distributed = dask("distributed")
    _silence()
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask().config.set(SETTINGS))
        with _undisturbed():
            cluster = distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL
            )
            stack.callback(cluster.close, timeout=5)
            client = distributed.Client(cluster)
            stack.callback(client.close, timeout=5)
        yield client


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Processes started in this block never hear a Ctrl-C of the terminal: who started them ends them.

    They inherit that it is ignored, so that for these two or three seconds it is ignored here too.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextlib.contextmanager
def existing_cluster(address: str) -> Iterator[Any]:
    """A client of the cluster whose scheduler listens at ``address``; the cluster stays.

    Raises:
        InputError: Dask is not installed, nobody answers, or a worker cannot fly our flights, or not with our
            sources.
    """
    distributed = dask("distributed")
    _silence()
    try:
        client = distributed.Client(address, timeout=CONNECTING)
    except (OSError, ValueError, ImportError) as error:
        raise InputError(f"no Dask scheduler at {address}: {' '.join(str(error).split())}") from None
    try:
        _check_workers(client, address)
        yield client
    finally:
        client.close(timeout=5)


def workers_of(client: Any) -> int:
    """How many processes fly for a client now."""
    return len(client.nthreads())


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=CONNECTING)
    except TimeoutError:
        raise InputError(f"the scheduler at {address} has no workers: dask worker {address} --nthreads 1") from None
    try:
        codes = client.run(flight_code)
    except Exception as error:
        raise InputError(f"a worker of {address} cannot fly: {type(error).__name__}: {error}") from None
    ours = flight_code()
    others = [worker for worker, code in codes.items() if code != ours]
    if others:
        raise InputError(f"{others[0]} has another version of Wingbeat's sources: its flights would differ")


def flight_code() -> str:
    """Digest of all sources and shipped files that a flight depends on, where this is called.

    Raises:
        ImportError: what a flight needs is not installed.
    """
    import avionics
    import logs
    import sim_bridge
    import wingbeat
    from logs.campaigns import single_flight

    digest = hashlib.sha256(single_flight.__name__.encode())
    for package in (wingbeat, avionics, logs, sim_bridge):
        root = Path(package.__path__[0])
        for path in sorted(path for path in root.rglob("*") if path.suffix in (".py", ".toml", ".xml", ".json")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def dask(module: str = "dask") -> Any:
    """A module of Dask.

    Raises:
        InputError: it is not installed.
    """
    return load_extra(module, "Dask", "a campaign", INSTALL)


def _silence() -> None:
    """What Dask logs of its own housekeeping is for nobody here: a flight that fails has its row."""
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
