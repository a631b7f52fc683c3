"""Dask clusters of campaigns, local or external."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import signal
import threading
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from logs.campaigns.table import INSTALL
from logs.extras import load_extra
from wingbeat.errors import InputError

CONNECTING = 10.0
"""s; timeout of the connection to a scheduler and its first worker"""
SETTINGS = {
    # A flight whose process ends is reported in its row, not repeated on every other worker.
    "distributed.scheduler.allowed-failures": 0,
    # The profiler samples every thread a hundred times a second; a worker only flies.
    "distributed.worker.profile.enabled": False,
    # By default the last thousand messages are kept, with all inputs of each flight.
    "distributed.admin.log-length": 0,
    "distributed.admin.low-level-log-length": 4,
    # The default housekeeping, fifty times a second in each process, slows the flights.
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
    """Start ``workers`` processes with a thread each and yield their client; they end with the block.

    Raises:
        InputError: Dask is not installed.
    """
    distributed = dask("distributed")
    _silence()
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask().config.set(SETTINGS))
        with _undisturbed():
            cluster = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0" if find_spec("bokeh") else None,
                silence_logs=logging.CRITICAL,
            )
            stack.callback(cluster.close, timeout=5)
            client = distributed.Client(cluster)
            stack.callback(client.close, timeout=5)
        yield client


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Start processes in this block that ignore a Ctrl-C of the terminal; the parent ends them.

    They inherit the ignored signal, so Ctrl-C is ignored here too for the two or three seconds of the block.
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
    """Yield a client of the cluster whose scheduler is at ``address``; the cluster is not stopped.

    Raises:
        InputError: Dask is not installed, no scheduler responds, or a worker lacks the flight code or has other
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


def dashboard_of(client: Any) -> str:
    """Return the address of the cluster's dashboard; empty without one (it needs Bokeh where the scheduler runs)."""
    port = client.scheduler_info().get("services", {}).get("dashboard")
    return client.dashboard_link if port else ""


def workers_of(client: Any) -> int:
    """Return the number of processes that run flights for a client."""
    return len(client.nthreads())


def worker_memory(client: Any) -> int:
    """Return the resident memory (bytes) of the largest worker process as last reported; 0 if unknown."""
    try:
        workers = client.scheduler_info().get("workers", {})
    except OSError:  # disconnected, which `fly_campaign` reports
        return 0
    return max((int(worker["metrics"].get("memory", 0)) for worker in workers.values()), default=0)


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
    """Return the digest of all sources and data files that a flight depends on, in the calling process.

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
    """Import a module of Dask.

    Raises:
        InputError: it is not installed.
    """
    return load_extra(module, "Dask", "a campaign", INSTALL)


def _silence() -> None:
    """Suppress the housekeeping logs of Dask: a failed flight is reported in its row."""
    for name in ("distributed", "tornado", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
