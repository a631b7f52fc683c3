"""Replay of a recorded flight, bit for bit or with other gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from avionics import parameters, snapshot, topics
from avionics.autopilot import Autopilot
from avionics.gains import FlightGains
from avionics.state import decode_state
from logs.reader import Log
from logs.replay.comparison import TopicDifference, comparison
from logs.replay.recorded_flight import RecordedFlight, Tick, recorded_flight
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean
from wingbeat.topic import Topic

PROGRESS = 200
"""number of ticks between progress reports"""
Progress = Callable[[int, int], None]
"""called with the completed and the total number of ticks"""


class Replayed(NamedTuple):
    """Result of a replay."""

    start: float
    """s; since boot, of the initial snapshot; 0 for the first tick"""
    end: float
    """s; since boot, of the last tick"""
    ticks: int
    """-; number of replayed ticks"""
    differences: tuple[TopicDifference, ...]
    """every recorded topic of the flight computer that is determined by the inputs of the flight"""
    late: str = ""
    """notice, one line, if the file begins in flight and was replayed from its first snapshot; else empty"""

    @property
    def same(self) -> bool:
        """Whether all messages are bit-identical."""
        return all(each.same for each in self.differences)


def replay_flight(
    log: Log,
    changes: Mapping[str, float] | None = None,
    start: float = 0.0,
    end: float = math.inf,
    progress: Progress | None = None,
) -> Replayed:
    """Replay sensors and inputs of a log through the flight code, and compare its output with the recording.

    Args:
        log: of a Wingbeat flight computer.
        changes: gains by parameter name (``PITCH_PROPORT``) or place in the vehicle file (``pitch.proportional``).
        start: s since boot; start from the last snapshot of the state not after it, or with the first tick. A file
            that begins in flight, such as a later one of a recording, starts at its first snapshot.
        end: s since boot; of the last tick.
        progress: called periodically.

    Raises:
        InputError: the log is not of a Wingbeat flight computer or is damaged, a gain is unknown or invalid, or there
            is no tick between ``start`` and ``end``.
    """
    flight = recorded_flight(log)
    began, autopilot, publish = _begin(flight, changes or {}, start)
    ticks = [tick for tick in flight.ticks if began < tick.frame.time_us <= end * 1e6]
    if not ticks or start > min(end, flight.ticks[-1].frame.time_us * 1e-6):
        raise InputError(_nothing(flight, start, end))
    last = ticks[-1].frame.time_us * 1e-6
    compared = {
        topic.name: comparison(log, topic, began * 1e-6 if began >= 0 else -math.inf, last)
        for topic in topics.TOPICS
        if topic.deterministic and topic.name in log.topics
    }
    publish.to = lambda topic, message: compared[topic.name].take(message) if topic.name in compared else None
    for done, tick in enumerate(ticks, 1):
        step(autopilot, tick)
        if progress is not None and done % PROGRESS == 0:
            progress(done, len(ticks))
    told = tuple(each.result() for each in compared.values())
    return Replayed(max(began, 0) * 1e-6, last, len(ticks), told, flight.late)


def _nothing(flight: RecordedFlight, start: float, end: float) -> str:
    first, last = (tick.frame.time_us * 1e-6 for tick in (flight.ticks[0], flight.ticks[-1]))
    asked = f"from {start:g} s on" if math.isinf(end) else f"from {start:g} to {end:g} s"
    return f"no ticks {asked}: the log covers {first:.3f} to {last:.3f} s"


def step(autopilot: Autopilot, tick: Tick) -> None:
    """Run one recorded tick.

    Time stamps corrected in flight are restored first, so that the correction is repeated.
    """
    offset_us = autopilot.memory.plausibility.time_offset_us
    frame = tick.frame.shifted(-offset_us) if offset_us else tick.frame
    autopilot.step(frame, tick.inputs)


class _Publish:
    """Publisher with a replaceable receiver."""

    def __init__(self) -> None:
        self.to: Callable[[Topic[Any], Any], None] = lambda topic, message: None

    def __call__(self, topic: Topic[Any], message: Any) -> None:
        self.to(topic, message)


def _begin(flight: RecordedFlight, changes: Mapping[str, float], start: float) -> tuple[int, Autopilot, _Publish]:
    """Return the start time (us), -1 for the first tick, and the flight computer at that time."""
    publish = _Publish()
    gains = changed(flight.vehicle.gains, changes)
    autopilot = Autopilot(flight.vehicle._replace(gains=gains), flight.mission, publish)
    earlier = [text for text in flight.snapshots if text.time_us <= start * 1e6]
    if not earlier and flight.from_boot:
        return -1, autopilot, publish
    time_us, text = earlier[-1] if earlier else flight.snapshots[0]
    if changes:
        state = decode_state(text)
        state.gains = changed(state.gains, changes)
        text = snapshot.encode(state)
    autopilot.restore(text)
    return time_us, autopilot, publish


def place_of(parameter: parameters.Parameter) -> str:
    """Return the location in a vehicle file: ``pitch.proportional``, ``flapping.throttle_points[1]``."""
    within = f"[{parameter.place}]" if parameter.place >= 0 else ""
    return f"{parameter.section}.{parameter.key}{within}"


def changed(gains: FlightGains, changes: Mapping[str, float]) -> FlightGains:
    """Return the gains with ``changes`` by parameter name or location in the vehicle file.

    Raises:
        InputError: an unknown gain, or an invalid value.
    """
    table = parameters.parameter_table(gains)
    places = {place_of(parameter): name for name, parameter in table.items()}
    for name, value in changes.items():
        if name not in places and name.upper() not in table:
            guess = did_you_mean(name, places) or did_you_mean(name.upper(), table)
            raise InputError(f"the flight computer has no gain {name!r}{guess}")
        change = parameters.set_value(gains, table, places.get(name, name.upper()), value)
        if not change.accepted or not math.isclose(change.value, value, rel_tol=1e-6):
            raise InputError(change.text)
        gains = change.gains
    return gains
