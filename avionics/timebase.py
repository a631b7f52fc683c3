"""The beat of the flight computer: ticks counted from the sensor time, and the time step of each rate."""

from __future__ import annotations

from typing import NamedTuple

from avionics.records import new

BASE_RATE = 200
"""Hz; of the IMU, one tick per sample"""
LONGEST_STEP = 0.1
"""s; a longer gap in the sensor time counts as this long in the loops"""


class Clock(NamedTuple):
    """Ticks, and for each rate the time of its last turn and its present step."""

    ticks: int = 0
    """-; since boot"""
    time_us: int = -1
    """us; sensor time of the tick, -1 before the first"""
    dt: float = 0.005
    """s; since the last tick"""
    last_100_us: int = -10_000
    last_50_us: int = -20_000
    last_20_us: int = -50_000
    dt_100: float = 0.01
    """s; since the last turn of the 100 Hz tasks"""
    dt_50: float = 0.02
    """s; since the last turn of the 50 Hz tasks"""
    dt_20: float = 0.05
    """s; since the last turn of the 20 Hz tasks"""


def first(time_us: int) -> Clock:
    """The first tick, every rate due with its nominal step."""
    return Clock(0, time_us, last_100_us=time_us, last_50_us=time_us, last_20_us=time_us)


def advance(clock: Clock, time_us: int) -> Clock:
    """The next tick; ``time_us`` must be later than the last."""
    if clock.time_us < 0:
        return first(time_us)
    _, last_us, _, last_100, last_50, last_20, dt_100, dt_50, dt_20 = clock
    ticks = clock.ticks + 1
    if ticks % 2 == 0:
        dt_100, last_100 = step_of(last_100, time_us), time_us
        if ticks % 4 == 0:
            dt_50, last_50 = step_of(last_50, time_us), time_us
        if ticks % 10 == 0:
            dt_20, last_20 = step_of(last_20, time_us), time_us
    dt = step_of(last_us, time_us)
    return new(Clock, (ticks, time_us, dt, last_100, last_50, last_20, dt_100, dt_50, dt_20))


def step_of(last_us: int, time_us: int) -> float:
    """Seconds between two sensor times, at most `LONGEST_STEP`."""
    step = (time_us - last_us) * 1e-6
    return step if step < LONGEST_STEP else LONGEST_STEP
