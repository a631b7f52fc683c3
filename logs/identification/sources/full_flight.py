"""From a log's topics to one experiment: all of a flight on the IMU's time base, every axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from avionics import topics
from avionics.sensing import inertial
from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import Channel, interpolated
from logs.identification.results import Array
from logs.identification.sources.topic_table import ColumnSource
from logs.strokes import strokes_of
from wingbeat.errors import InputError
from wingbeat.topic import Topic

LONGEST_GAP = 0.1
"""s; bridged by a straight line"""
LEAST_SAMPLES = 20


class Wanted(NamedTuple):
    """A field and the signal that it becomes."""

    topic: Topic[Any]
    field: str
    signal: str
    unit: str
    held: bool = False
    """-; a command or a flag, which stays until the next message"""
    turns: bool = False
    """-; an angle that wraps at pi"""


WANTED = (
    Wanted(topics.IMU, "gyro_x", "p", "rad/s"),
    Wanted(topics.IMU, "gyro_y", "q", "rad/s"),
    Wanted(topics.IMU, "gyro_z", "r", "rad/s"),
    Wanted(topics.IMU, "accel_x", "a_x", "m/s^2"),
    Wanted(topics.IMU, "accel_y", "a_y", "m/s^2"),
    Wanted(topics.IMU, "accel_z", "a_z", "m/s^2"),
    Wanted(topics.ATTITUDE, "roll", "phi", "rad", turns=True),
    Wanted(topics.ATTITUDE, "pitch", "theta", "rad"),
    Wanted(topics.ATTITUDE, "yaw", "psi", "rad", turns=True),
    Wanted(topics.AIR_DATA, "airspeed", "airspeed", "m/s"),
    Wanted(topics.ALTITUDE, "altitude", "altitude", "m"),
    Wanted(topics.ALTITUDE, "climb_rate", "climb_rate", "m/s"),
    Wanted(topics.POSITION, "north", "north", "m"),
    Wanted(topics.POSITION, "east", "east", "m"),
    Wanted(topics.ACTUATORS, "elevator", "elevator", "rad", held=True),
    Wanted(topics.ACTUATORS, "rudder", "rudder", "rad", held=True),
    Wanted(topics.ACTUATORS, "throttle", "throttle", "-", held=True),
    Wanted(topics.EXCITATION, "active", "active", "-", held=True),
    Wanted(topics.EXCITATION, "manoeuvre", "manoeuvre", "-", held=True),
    Wanted(topics.EXCITATION, "aborted", "aborted", "-", held=True),
    Wanted(topics.EXCITATION, "elevator", "excitation_elevator", "rad", held=True),
    Wanted(topics.EXCITATION, "rudder", "excitation_rudder", "rad", held=True),
    Wanted(topics.EXCITATION, "throttle", "excitation_throttle", "-", held=True),
)
"""the specific forces and rates are the IMU's own, biases included"""


def whole_flight(source: ColumnSource, name: str, calibration: inertial.Gains = inertial.NEUTRAL) -> Experiment:
    """All that a log tells of a flight's motion, the specific forces corrected by the IMU's ``calibration``.

    Signals as in `WANTED`, and ``strokes`` counted by the wing's phase; a field that was not recorded is left out.
    Before a signal's first and behind its last message, and in gaps over 0.1 s, it is NaN.

    Raises:
        InputError: the log has no IMU, or a topic that is there is damaged.
    """
    channels = {wanted.signal: channel for wanted in WANTED if (channel := _channel(source, wanted))}
    if "q" not in channels:
        raise InputError(f"the log has no topic {topics.IMU.name}, which this needs")
    for axis, signal in enumerate(("a_x", "a_y", "a_z")):
        if signal in channels:
            values = (channels[signal].values - calibration.accel_offset[axis]) * calibration.accel_scale[axis]
            channels[signal] = channels[signal]._replace(values=values)
    base = channels["q"].time
    step = float(np.median(np.diff(base)))
    time = base[0] + step * np.arange(int((base[-1] - base[0]) / step + 1e-6) + 1)
    held = {wanted.signal for wanted in WANTED if wanted.held}
    signals = {s: _held(c, time) if s in held else interpolated(c.time, c.values, time, LONGEST_GAP)
               for s, c in channels.items()}  # fmt: skip
    units = {wanted.signal: wanted.unit for wanted in WANTED if wanted.signal in channels}
    return Experiment(name, time, {**signals, **_strokes(source, time)}, {**units, "strokes": "-"})


def _read(source: ColumnSource, topic: Topic[Any], field: str) -> tuple[Array, Array] | None:
    """Time (s) and finite values of a field in order of time; None where it was not recorded."""
    try:
        columns: Mapping[str, Array] = source.columns(topic)
        time, values = (np.asarray(columns[key], dtype=np.float64) for key in ("time_us", field))
    except KeyError:
        return None
    except InputError:
        if topic.name in getattr(source, "topics", ()):
            raise  # it is there, and damaged
        return None
    good = np.isfinite(time) & np.isfinite(values)
    time, values = time[good] * 1e-6, values[good]
    rising = np.concatenate(([True], np.diff(np.maximum.accumulate(time)) > 0))[: len(time)]
    return (time[rising], values[rising]) if rising.sum() >= LEAST_SAMPLES else None


def _channel(source: ColumnSource, wanted: Wanted) -> Channel | None:
    read = _read(source, wanted.topic, wanted.field)
    if read is None:
        return None
    return Channel(wanted.signal, wanted.unit, read[0], np.unwrap(read[1]) if wanted.turns else read[1])


def _held(channel: Channel, time: Array) -> Array:
    """Held since the last message; NaN before the first."""
    index = np.searchsorted(channel.time, time + 1e-7, side="right") - 1
    values: Array = np.where(index < 0, np.nan, channel.values[np.clip(index, 0, None)])
    return values


def _strokes(source: ColumnSource, time: Array) -> dict[str, Array]:
    phase = _read(source, topics.WING, "phase")
    return {} if phase is None else {"strokes": interpolated(phase[0], strokes_of(phase[1]), time, LONGEST_GAP)}
