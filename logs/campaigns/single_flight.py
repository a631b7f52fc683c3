"""One flight of a campaign in one process, with a row in any case."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from avionics.autopilot import Autopilot
from logs.campaigns.keys import Values
from logs.campaigns.memory import Memory
from logs.campaigns.metrics import METRICS, measured
from logs.campaigns.outcome import Evaluation, Judged, Landing, Outcome, judge
from logs.campaigns.prepared import Prepared, prepare
from logs.campaigns.stock import Stock
from logs.names import STICKS
from logs.outline import shape_of
from logs.recorder import McapRecorder
from logs.recording_notes import note_inputs, note_scenario
from logs.scene import SceneRecorder
from logs.summary import summary_of
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import SimulatedWorld, publish_nothing
from wingbeat.errors import InputError
from wingbeat.topic import Publish

UNFINISHED = ".part"
"""suffix of a log while it is being recorded"""

Row = dict[str, Any]
"""one flight of the table: the columns of `OWN` and the metrics"""
OWN = {
    "flight": "number of the flight",
    "failed": "whether it neither landed nor was still in the air at its end",
    "outcome": "how it ended",
    "reason": "why it failed",
    "log": "name of its recording, empty for none",
}
_TYPES = {"flight": int, "failed": bool} | dict.fromkeys(("outcome", "reason", "log"), str)


def is_row(value: Any) -> bool:
    """Check that a JSON value is a `Row`: all columns with values of their types."""
    return (
        isinstance(value, dict)
        and all(type(value.get(name)) is kind for name, kind in _TYPES.items())
        and all(name in value and _is_metric(value[name]) for name in METRICS)
    )


def _is_metric(value: Any) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool))


class Recording(NamedTuple):
    """Recording of a flight in a campaign."""

    path: Path
    failed_only: bool = False


class Order(NamedTuple):
    """Specification of one flight."""

    number: int
    """-; from 1"""
    values: Values
    stock: Stock
    landing: Landing
    recording: Recording | None = None


class CannotRecord(InputError):
    """Error: a flight's log cannot be written; the flight itself did not cause it."""


class _World(SimulatedWorld):
    """Simulated world that ends if the vehicle's position is NaN, because all later data would be NaN."""

    def __init__(self, flight: Prepared, memory: Memory) -> None:
        self._memory = memory
        super().__init__(flight.vehicle, flight.scenario, memory.publish)

    @property
    def finished(self) -> bool:
        return self._memory.broken or super().finished


def fly_one(order: Order) -> Row:
    """Run one flight and compute its metrics.

    Raises:
        CannotRecord: its log cannot be written; all other errors are reported in the row.
    """
    recording = order.recording
    row = row_of(order.number, *_outcome_of(order))
    if recording is None:
        return row
    unfinished = recording.path.with_name(recording.path.name + UNFINISHED)
    kept = unfinished.exists() and (row["failed"] or not recording.failed_only)
    if kept:
        os.replace(unfinished, recording.path)  # noqa: PTH105 (an earlier try of the same flight may lie there)
    unfinished.unlink(missing_ok=True)
    return row | {"log": recording.path.name if kept else ""}


def row_of(number: int, judged: Evaluation, metrics: dict[str, float | None] | None = None) -> Row:
    """Build a flight's row; without metrics if there are none."""
    told = {"failed": judged.failed, "outcome": judged.outcome.value, "reason": judged.reason, "log": ""}
    return {"flight": number, **told, **(metrics or dict.fromkeys(METRICS))}


def _outcome_of(order: Order) -> tuple[Evaluation, dict[str, float | None] | None]:
    try:
        flight = prepare(order.stock, order.values)
    except InputError as reason:
        return Evaluation(Outcome.REFUSED, str(reason)), None
    memory = Memory()
    try:
        with _recorded(order, flight) as publish:
            memory = Memory(publish)
            autopilot = Autopilot(flight.computer, flight.plan.mission, memory.publish)
            fly(_World(flight, memory), autopilot, flight.commands)
    except CannotRecord:
        raise
    except Exception as error:
        if not memory.broken:
            return _raised(error), None
    if memory.broken:
        return Evaluation(Outcome.NOT_A_NUMBER, "the vehicle's place was no number"), None
    return _judged(order, flight, memory)


def _raised(error: Exception) -> Evaluation:
    """Format an exception on one line."""
    if isinstance(error, InputError):
        return Evaluation(Outcome.REFUSED, str(error))
    text = " ".join(str(error).split())
    return Evaluation(Outcome.ERROR, f"{type(error).__name__}: {text}" if text else type(error).__name__)


def _judged(order: Order, flight: Prepared, memory: Memory) -> tuple[Evaluation, dict[str, float | None] | None]:
    tables = memory.tables()
    times = [columns.time for columns in tables.values()]
    if not times:
        return Evaluation(Outcome.NOT_LAUNCHED, "it ended before it began"), None
    summary = summary_of(tables, float(max(time[-1] for time in times)))
    by_hand = flight.sticks is not None
    found = judge(Judged(summary, tables, flight.computer.gains.modes, order.landing, by_hand))
    return found, measured(summary, tables)


@contextmanager
def _recorded(order: Order, flight: Prepared) -> Iterator[Publish]:
    """Yield the recorder of a flight: its log, or no recording.

    Raises:
        CannotRecord: the log cannot be written.
    """
    if order.recording is None:
        yield publish_nothing
        return
    path = order.recording.path
    unfinished = path.with_name(path.name + UNFINISHED)
    try:
        unfinished.unlink(missing_ok=True)
    except OSError as error:
        raise CannotRecord(f"cannot record to {path}: {error.strerror or error}") from None
    with recorded(unfinished, flight) as publish:
        yield publish


@contextmanager
def recorded(path: Path, flight: Prepared) -> Iterator[Publish]:
    """Yield the function that records a flight's messages to the new file ``path``.

    Raises:
        CannotRecord: the log cannot be written.
    """
    with _recorder(path) as recorder:
        note_flight(recorder, flight)
        yield SceneRecorder(recorder, shape_of(flight.vehicle), recorder.start_epoch_ns).record
    if recorder.failure:
        raise CannotRecord(recorder.failure)


def _recorder(path: Path) -> McapRecorder:
    try:
        return McapRecorder(path)
    except OSError as error:
        raise CannotRecord(f"cannot record to {path}: {error.strerror or error}") from None
    except InputError as error:
        raise CannotRecord(str(error)) from None


def note_flight(recorder: McapRecorder, flight: Prepared) -> None:
    """Record all inputs of the flight, as the two processes of ``wingbeat fly`` do."""
    note_scenario(recorder, flight.vehicle, flight.scenario)
    note_inputs(recorder, flight.computer, flight.plan.mission)
    if flight.sticks is not None:
        recorder.attach(STICKS, "text/csv", flight.sticks.text.encode())
