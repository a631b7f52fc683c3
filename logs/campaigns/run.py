"""Scheduling of the flights of a campaign on a cluster."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from logs.campaigns.campaign import Campaign
from logs.campaigns.cluster import dask, workers_of
from logs.campaigns.outcome import Evaluation, Outcome
from logs.campaigns.single_flight import UNFINISHED, CannotRecord, Order, Recording, Row, fly_one, row_of
from wingbeat.errors import InputError

LOGS = ("none", "failed", "all")
"""options of which flights are recorded"""
MIN_FLIGHTS = 20
"""-; least number of flights from which the time of others is estimated"""
LOOK = 1.0
"""s; interval of checks of the cluster"""
PATIENCE = 60
"""number of checks without a worker after which the campaign is suspended"""


class ResourceUsage(NamedTuple):
    """Time and memory of the flights of one command."""

    flights: int = 0
    wall_time: float = 0.0
    """s; of the command"""
    elapsed: float = 0.0
    """s; since the workers were ready"""
    early_memory: int = 0
    """bytes; largest worker process during the first tenth of the flights, 0 if unknown"""
    memory: int = 0
    """bytes; largest worker process"""

    def with_flight(self, planned: int, elapsed: float, memory: int) -> ResourceUsage:
        """Add one of ``planned`` flights, which ended after ``elapsed`` s with workers of ``memory`` bytes."""
        peak = max(self.memory, memory)
        early = peak if 10 * self.flights < planned else self.early_memory
        return self._replace(flights=self.flights + 1, elapsed=elapsed, early_memory=early, memory=peak)

    def time_of(self, flights: int) -> float | None:
        """Return the time (s) of that many flights at the measured rate; None if too few were flown to tell."""
        return self.elapsed / self.flights * flights if self.flights >= MIN_FLIGHTS else None


class Logs(NamedTuple):
    """Selection of the flights to record, and their folder."""

    keep: str
    """-; one of `LOGS`"""
    folder: Path

    def of(self, number: int) -> Recording | None:
        """Return the recording of a flight; None if it is not recorded."""
        if self.keep == "none":
            return None
        return Recording(self.folder.absolute() / f"flight-{number:05d}.mcap", self.keep == "failed")


def order_of(campaign: Campaign, number: int, recording: Recording | None = None) -> Order:
    """Build the order of flight ``number``."""
    return Order(number, campaign.values(number), campaign.stock, campaign.landing, recording)


def fly_campaign(campaign: Campaign, numbers: Sequence[int], client: Any, logs: Logs) -> Iterator[Row]:
    """Run flights ``numbers`` and yield their rows in the order of completion.

    Raises:
        InputError: the cluster disconnected, or a log cannot be written.
    """
    wait_for = dask("distributed").wait
    left, flying, alone = list(reversed(numbers)), dict[Any, int](), 0
    try:
        while left or flying:
            while left and len(flying) < max(workers_of(client), 1):
                number = left.pop()
                order = order_of(campaign, number, logs.of(number))
                flying[client.submit(fly_one, order, key=f"{campaign.name}-{number}", pure=False, retries=0)] = number
            with contextlib.suppress(TimeoutError):
                wait_for(list(flying), timeout=LOOK, return_when="FIRST_COMPLETED")
            for future in [one for one in flying if one.done()]:
                yield _row(future, flying.pop(future), logs)
            alone = 0 if workers_of(client) else alone + 1
            if alone > PATIENCE or client.status != "running":
                raise InputError("cluster disconnected; the same command resumes")
    finally:
        with contextlib.suppress(Exception):
            client.cancel(list(flying))


def _row(future: Any, number: int, logs: Logs) -> Row:
    """Return the row of a completed future.

    Raises:
        InputError: the cluster returned the flight without a result, or its log cannot be written.
    """
    if future.status == "finished":
        row: Row = future.result()
        return row
    if future.status == "cancelled":
        raise InputError("cluster disconnected; the same command resumes")
    error = future.exception()
    if isinstance(error, CannotRecord):
        raise InputError(f"{error}; run the same command to resume after that")
    if type(error).__name__ == "KilledWorker":
        judged = Evaluation(Outcome.KILLED, "the process that flew it was ended from outside")
    else:
        judged = Evaluation(Outcome.ERROR, f"{type(error).__name__}: {' '.join(str(error).split())}")
    return row_of(number, judged) | {"log": _kept(number, logs)}


def _kept(number: int, logs: Logs) -> str:
    """Return the name of the log of a flight whose process ended; it can be repaired."""
    recording = logs.of(number)
    if recording is None:
        return ""
    unfinished = recording.path.with_name(recording.path.name + UNFINISHED)
    if not unfinished.exists():
        return ""
    unfinished.replace(recording.path)
    return recording.path.name
