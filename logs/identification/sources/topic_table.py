"""Topics of a log as columns, and a whole flight as one experiment."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Container, Iterable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from avionics import topics
from logs.identification.data.experiment import Experiment
from logs.identification.data.flight import NEUTRAL, FlightData, ImuCalibration, JoinedFlight
from logs.identification.data.resampling import Channel, interpolated
from logs.identification.results import Array
from logs.reader import Log
from logs.strokes import strokes_of
from wingbeat.errors import InputError
from wingbeat.text import pluralize
from wingbeat.topic import Topic

MIN_SAMPLES = 20


class ColumnSource(Protocol):
    """A log, or anything else that gives a topic's fields as arrays."""

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name; a topic that was not recorded is refused or empty."""


class TopicTable:
    """Columns of one topic with its time in seconds, without samples that are not finite."""

    def __init__(self, source: ColumnSource, topic: Topic[Any], *fields: str) -> None:
        try:
            columns = source.columns(topic)
            arrays = [np.asarray(columns[field], dtype=float) for field in ("time_us", *fields)]
        except (KeyError, InputError) as error:
            if isinstance(error, InputError) and topic.name in getattr(source, "topics", ()):
                raise  # it is damaged, so nothing replaces it
            raise InputError(f"the log has no topic {topic.name}, which this needs") from None
        if len(arrays[0]) < MIN_SAMPLES:
            raise InputError(f"topic {topic.name} has {len(arrays[0])} messages; identification needs {MIN_SAMPLES}")
        good = np.all(np.isfinite(arrays), axis=0)
        good[1:] &= np.diff(np.maximum.accumulate(arrays[0])) > 0
        if good.sum() < MIN_SAMPLES:
            raise InputError(f"topic {topic.name} has too few finite samples in order of time")
        self.time: Array = arrays[0][good] * 1e-6
        """s; (N,), since boot, rising"""
        self._fields = {field: array[good] for field, array in zip(fields, arrays[1:], strict=True)}

    def __getitem__(self, field: str) -> Array:
        return self._fields[field]

    def linear(self, field: str, time: Array) -> Array:
        """The field at ``time`` (s; (M,)), linear between samples; as the topic has it."""
        values: Array = np.interp(time, self.time, self._fields[field])
        return values

    def zero_order_hold(self, field: str, time: Array) -> Array:
        """The field at ``time`` (s; (M,)) as of its last sample; the first sample's value before it."""
        index = np.clip(np.searchsorted(self.time, time + 1e-7, side="right") - 1, 0, None)
        return self._fields[field][index]


class CachedSource:
    """Columns of ``source``, read once per topic."""

    def __init__(self, source: ColumnSource) -> None:
        self._source = source
        self._columns: dict[str, Mapping[str, Any]] = {}

    @property
    def topics(self) -> Container[str]:
        """Names of the topics that the source has; none if it does not list them."""
        names: Container[str] = getattr(self._source, "topics", ())
        return names

    def read_together(self, several: Iterable[Topic[Any]]) -> None:
        """Read those of the topics that the source has in one pass, if it is a log: each pass unpacks all of it."""
        if isinstance(self._source, Log):
            with contextlib.suppress(InputError):  # raised again for the topic that is damaged
                self._columns |= self._source.tables([one for one in several if one.name in self._source.topics])

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name.

        Raises:
            InputError: as of the source.
        """
        if topic.name not in self._columns:
            self._columns[topic.name] = self._source.columns(topic)
        return self._columns[topic.name]


class ElevatorFromField(NamedTuple):
    """A `ColumnSource` whose elevator command is ``field`` of ``topic`` times ``scale``: a pulse width or a stick.

    The zero of the field does not matter: inputs are changes of the angle.
    """

    log: Log
    topic: str
    field: str
    scale: float
    """rad per unit of the field; positive pitches the nose up"""
    assumed: bool = False
    """the travel is not recorded: derivatives by the elevator scale with it, modes do not"""

    @property
    def note(self) -> str:
        """Line of the report."""
        known = "; assumed, derivatives scale with it: --elevator sets it" if self.assumed else ""
        return f"elevator: {self.topic}.{self.field} at {self.scale:g} rad per unit{known}"

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name.

        Raises:
            InputError: the log has no such topic, or the field is no number.
        """
        if topic != topics.ACTUATORS:
            return self.log.columns(topic)
        columns = self.log.columns(self.topic)
        name, _, place = self.field.rstrip("]").partition("[")
        values = columns.fields.get(name)
        if values is not None and place.isdigit() and values.ndim == 2 and int(place) < values.shape[1]:
            values = values[:, int(place)]
        if values is None or values.ndim != 1 or values.dtype.kind not in "fiu":
            numbers = [name for name, each in columns.items() if each.ndim == 1 and each.dtype.kind in "fiu"]
            raise InputError(f"{self.topic} has no number {self.field}; it has: {', '.join(numbers)}")
        return {"time_us": np.rint(columns.time * 1e6), "elevator": values * self.scale}


def time_base(time: Array) -> Array:
    """Times (s) equally spaced over the record ``time`` (s; (N,)), at its median step, gaps and all."""
    step = float(np.median(np.diff(time)))
    base: Array = time[0] + step * np.arange(int((time[-1] - time[0]) / step + 1e-6) + 1)
    return base


LONGEST_GAP = 0.1
"""s; interpolated linearly"""


class SignalSource(NamedTuple):
    """A field of a topic and its signal."""

    topic: Topic[Any]
    field: str
    signal: str
    unit: str
    zero_order_hold: bool = False
    """-; a command or a flag, which is constant until the next message"""
    wraps: bool = False
    """-; an angle that wraps at pi"""


SOURCES = (
    SignalSource(topics.IMU, "gyro_x", "p", "rad/s"),
    SignalSource(topics.IMU, "gyro_y", "q", "rad/s"),
    SignalSource(topics.IMU, "gyro_z", "r", "rad/s"),
    SignalSource(topics.IMU, "accel_x", "a_x", "m/s^2"),
    SignalSource(topics.IMU, "accel_y", "a_y", "m/s^2"),
    SignalSource(topics.IMU, "accel_z", "a_z", "m/s^2"),
    SignalSource(topics.ATTITUDE, "roll", "phi", "rad", wraps=True),
    SignalSource(topics.ATTITUDE, "pitch", "theta", "rad"),
    SignalSource(topics.ATTITUDE, "yaw", "psi", "rad", wraps=True),
    SignalSource(topics.AIR_DATA, "airspeed", "airspeed", "m/s"),
    SignalSource(topics.ALTITUDE, "altitude", "altitude", "m"),
    SignalSource(topics.ALTITUDE, "climb_rate", "climb_rate", "m/s"),
    SignalSource(topics.POSITION, "north", "north", "m"),
    SignalSource(topics.POSITION, "east", "east", "m"),
    SignalSource(topics.ACTUATORS, "elevator", "elevator", "rad", zero_order_hold=True),
    SignalSource(topics.ACTUATORS, "rudder", "rudder", "rad", zero_order_hold=True),
    SignalSource(topics.ACTUATORS, "throttle", "throttle", "-", zero_order_hold=True),
    SignalSource(topics.EXCITATION, "active", "active", "-", zero_order_hold=True),
    SignalSource(topics.EXCITATION, "manoeuvre", "manoeuvre", "-", zero_order_hold=True),
    SignalSource(topics.EXCITATION, "aborted", "aborted", "-", zero_order_hold=True),
    SignalSource(topics.EXCITATION, "elevator", "excitation_elevator", "rad", zero_order_hold=True),
    SignalSource(topics.EXCITATION, "rudder", "excitation_rudder", "rad", zero_order_hold=True),
    SignalSource(topics.EXCITATION, "throttle", "excitation_throttle", "-", zero_order_hold=True),
)
"""specific forces and rates are the IMU's, biases included"""


def whole_flight(source: ColumnSource, name: str, calibration: ImuCalibration = NEUTRAL) -> Experiment:
    """The motion of a flight, specific forces corrected by the IMU's ``calibration``.

    Signals as in `SOURCES`, and ``strokes`` counted by the wing's phase; a field that was not recorded is left out.
    A signal is NaN before its first and after its last message, and in gaps over 0.1 s.

    Raises:
        InputError: the log has no IMU, or a topic that is there is damaged.
    """
    channels = {one.signal: channel for one in SOURCES if (channel := _channel(source, one))}
    if "q" not in channels:
        raise InputError(f"the log has no topic {topics.IMU.name}, which this needs")
    for axis, signal in enumerate(("a_x", "a_y", "a_z")):
        if signal in channels:
            values = calibration.correct(channels[signal].values, axis)
            channels[signal] = channels[signal]._replace(values=values)
    base = channels["q"].time
    step = float(np.median(np.diff(base)))
    time = base[0] + step * np.arange(int((base[-1] - base[0]) / step + 1e-6) + 1)
    commands = {one.signal for one in SOURCES if one.zero_order_hold}
    signals = {s: _last_value(c, time) if s in commands else interpolated(c.time, c.values, time, LONGEST_GAP)
               for s, c in channels.items()}  # fmt: skip
    units = {one.signal: one.unit for one in SOURCES if one.signal in channels}
    return Experiment(name, time, {**signals, **_strokes(source, time)}, {**units, "strokes": "-"})


def _read(source: ColumnSource, topic: Topic[Any], field: str) -> tuple[Array, Array] | None:
    """Time (s) and finite values of a field in order of time; None if it was not recorded."""
    try:
        columns: Mapping[str, Array] = source.columns(topic)
        time, values = (np.asarray(columns[key], dtype=np.float64) for key in ("time_us", field))
    except KeyError:
        return None
    except InputError:
        if topic.name in getattr(source, "topics", ()):
            raise  # it is damaged
        return None
    good = np.isfinite(time) & np.isfinite(values)
    time, values = time[good] * 1e-6, values[good]
    rising = np.concatenate(([True], np.diff(np.maximum.accumulate(time)) > 0))[: len(time)]
    return (time[rising], values[rising]) if rising.sum() >= MIN_SAMPLES else None


def _channel(source: ColumnSource, one: SignalSource) -> Channel | None:
    read = _read(source, one.topic, one.field)
    if read is None:
        return None
    return Channel(one.signal, one.unit, read[0], np.unwrap(read[1]) if one.wraps else read[1])


def _last_value(channel: Channel, time: Array) -> Array:
    """The value of the last message; NaN before the first."""
    index = np.searchsorted(channel.time, time + 1e-7, side="right") - 1
    values: Array = np.where(index < 0, np.nan, channel.values[np.clip(index, 0, None)])
    return values


def _strokes(source: ColumnSource, time: Array) -> dict[str, Array]:
    phase = _read(source, topics.WING, "phase")
    return {} if phase is None else {"strokes": interpolated(phase[0], strokes_of(phase[1]), time, LONGEST_GAP)}


UNEVEN = 1e-3
"""-; of a sampling interval, by which those of two flights may differ"""

PAUSE = 4.0
"""s; of rest between joined flights"""


def joined_flights(flights: tuple[FlightData, ...], names: tuple[str, ...] = ()) -> FlightData:
    """The flights one after the other, numbered consecutively; ``names`` are those of their logs.

    A pause at rest separates two flights, and no maneuver is active in a flight's first and last stroke, so that no
    average contains samples of two flights.

    Raises:
        InputError: their samples are not equally far apart.
    """
    steps = [float(np.median(np.diff(flight.time))) for flight in flights]
    if max(steps) - min(steps) > UNEVEN * steps[0]:
        raise InputError(f"the logs' IMUs sample every {min(steps):.4g} s and {max(steps):.4g} s: they must agree")
    pieces = [_with_pause(_inner_strokes(flight), steps[0]) for flight in flights]
    columns = {name: [getattr(one, name) for one in pieces] for name in FlightData.arrays()}
    before = [0, *np.cumsum([int(one.manoeuvre.max()) for one in pieces])]
    for name in ("strokes", "manoeuvre"):
        columns[name] = _counted_on(columns[name])
    count = sum(len(one.time) for one in pieces)
    columns["time"] = [pieces[0].time[0] + steps[0] * np.arange(count)]
    whole = {name: np.concatenate(parts) for name, parts in columns.items()}
    notes = dict.fromkeys(note for flight in flights for note in flight.notes)
    begins = whole["time"][np.cumsum([0, *(len(one.time) for one in pieces[:-1])])]
    named = names or tuple(f"flight {number}" for number in range(1, len(flights) + 1))
    places = tuple(
        JoinedFlight(name, float(begin), float(one.time[0]), int(count))
        for name, begin, one, count in zip(named, begins, pieces, before[:-1], strict=True)
    )
    return FlightData(**whole, notes=(f"together: {pluralize(len(flights), 'flight')}", *notes), flights=places)


def _inner_strokes(flight: FlightData) -> FlightData:
    """The flight without an input in its first and its last stroke."""
    inner = (flight.strokes > flight.strokes[0] + 1.0) & (flight.strokes < flight.strokes[-1] - 1.0)
    return flight._replace(active=np.where(inner, flight.active, 0.0))


def _with_pause(flight: FlightData, step: float) -> FlightData:
    """The flight, and behind it its last sample for longer than a stretch of strokes may be interrupted."""
    still = math.ceil((PAUSE) / step)
    names = FlightData.arrays()
    longer: dict[str, Any] = {name: np.pad(getattr(flight, name), (0, still), mode="edge") for name in names}
    return flight._replace(**longer)


def _counted_on(parts: list[Array]) -> list[Array]:
    """Counts of which each goes on where the one before ended."""
    found, last = [], 0.0
    for part in parts:
        found.append(part + last)
        last = float(found[-1].max())
    return found
