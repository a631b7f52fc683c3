"""A flight that needs no simulator: a bird that circles and climbs, its messages at their topics' rates."""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Callable, Iterator
from typing import Any

from avionics import messages as m
from avionics import topics
from sim_bridge import messages as w
from sim_bridge import topics as truth_topics
from wingbeat.topic import Topic

FREQUENCY = 4.0
"""Hz; of the strokes"""
AMPLITUDE = 0.6
"""rad"""
RADIUS, SPEED, CLIMB = 30.0, 6.0, 0.5
"""m, m/s, m/s"""
LAUNCH = 2.0
"""s"""


def yaw(t: float) -> float:
    """rad; -pi to pi, of a circle to the right."""
    return (SPEED / RADIUS * t + math.pi) % (2.0 * math.pi) - math.pi


def flap(t: float) -> float:
    return AMPLITUDE * math.sin(2.0 * math.pi * FREQUENCY * t)


def place(t: float) -> tuple[float, float, float]:
    """north, east, down (m)"""
    turn = SPEED / RADIUS * t
    return RADIUS * math.sin(turn), RADIUS * (1.0 - math.cos(turn)), -1.5 - CLIMB * t


def _turn(t: float) -> tuple[float, float, float, float]:
    return math.cos(0.5 * yaw(t)), 0.0, 0.0, math.sin(0.5 * yaw(t))


def _attitude(us: int, t: float) -> m.Attitude:
    return m.Attitude(us, 0.1, 0.2, yaw(t), *(0.0,) * 3, *_turn(t), *(0.0,) * 9, 0, 0)


def _wing(us: int, t: float) -> m.WingState:
    phase = 2.0 * math.pi * ((FREQUENCY * t) % 1.0)
    angles = (flap(t), flap(t), 0.0, 0.0, phase, FREQUENCY, AMPLITUDE, AMPLITUDE, 0.0, 0.5)
    return m.WingState(us, *angles, int(FREQUENCY * t), 1, 0.5, 0.5, 1, 1, 0)


def _power(us: int, t: float) -> m.PowerState:
    return m.PowerState(us, 8.0, 2.0, 16.0 + flap(t), 0.0, 0.0, 0.0, 1.0 - 1e-4 * t, 8.2, 0.1, 0.0, 0)


def _navigation(us: int, t: float) -> m.NavigationStatus:
    stage = m.Stage.CLIMB_OUT if t >= LAUNCH else m.Stage.WAIT_LAUNCH
    mode = m.Mode.AUTO if t >= 1.0 else m.Mode.STABILIZED
    return m.NavigationStatus(us, mode, stage, 1, 0, 0.0, 0.0, 40.0, yaw(t), 0)


def _position(us: int, t: float) -> m.Position:
    north, east, _ = place(t)
    return m.Position(us, north, east, *(0.0,) * 6, 1.0, 1, *(0.0,) * 8)


def _state(us: int, t: float) -> w.TruthState:
    return w.TruthState(us, *place(t), SPEED, 0.0, -CLIMB, *_turn(t), *(0.0,) * 6, SPEED, 0.0, 0)


def _true_wing(us: int, t: float) -> w.TruthWing:
    return w.TruthWing(us, flap(t), flap(t), 0.0, 0.0, 0.1, 0.1, 0.0, 0.0, 2.0, 8.0, 16.0, 0.05, 0.02)


BUILDERS: dict[Topic, Callable[[int, float], Any]] = {
    topics.ATTITUDE: _attitude,
    topics.WING: _wing,
    topics.POWER: _power,
    topics.AIR_DATA: lambda us, t: m.AirData(us, SPEED, *(0.0,) * 9),
    topics.ALTITUDE: lambda us, t: m.Altitude(us, CLIMB * t, CLIMB, *(0.0,) * 5),
    topics.POSITION: _position,
    topics.NAVIGATION: _navigation,
    topics.PITCH_LOOP: lambda us, t: m.PitchStatus(us, 0.2, *(0.0,) * 5, 0),
    topics.ROLL_LOOP: lambda us, t: m.RollStatus(us, 0.1, *(0.0,) * 5, 0),
    topics.FLAP: lambda us, t: m.FlapCommand(us, FREQUENCY, AMPLITUDE, 0.0, 0.0, 0.0),
    truth_topics.STATE: _state,
    truth_topics.WING: _true_wing,
}
TRUTH = (truth_topics.STATE, truth_topics.WING)
ONBOARD = tuple(topic for topic in BUILDERS if topic not in TRUTH)


def messages(duration: float, chosen: tuple[Topic, ...] = tuple(BUILDERS)) -> Iterator[tuple[Topic, Any]]:
    """Messages of ``duration`` s in the order of their times, each topic at its rate."""
    streams = [_stream(topic, duration) for topic in chosen]
    yield from ((topic, message) for _, _, topic, message in heapq.merge(*streams, key=lambda entry: entry[:2]))


def _stream(topic: Topic, duration: float) -> Iterator[tuple[int, int, Topic, Any]]:
    build = BUILDERS[topic]
    for n in range(1, int(duration * topic.rate) + 1):
        time_us = round(n / topic.rate * 1e6)
        yield time_us, topic.channel, topic, build(time_us, time_us * 1e-6)


def noisy(message: Any, source: random.Random) -> Any:
    """``message`` with noise of up to a hundredth of its size, and a thousandth, on all its real numbers."""
    noise = source.random
    values = [v + (noise() - 0.5) * (2e-3 + 2e-2 * abs(v)) if isinstance(v, float) else v for v in message]
    return type(message)(*values)
