"""The beat of the flight computer: ticks counted from the sensor time, and the time step of each rate."""

from __future__ import annotations

from typing import NamedTuple

from wingbeat.records import constructor

BASE_RATE = 200
"""Hz; of the IMU, one tick per sample"""
LONGEST_STEP = 0.1
"""s; a longer gap in the sensor time counts as this long in the loops"""
NOMINAL_US = 1_000_000 // BASE_RATE
"""us; between two ticks"""
MEMORY = 10
"""-; ticks whose times are kept: a turn of the slowest rate with a step, 20 Hz"""


class Clock(NamedTuple):
    """Ticks, and for each rate its present step.

    A rate's step is the time since as many ticks ago as it divides the base rate by. So it is the time since the
    last turn of a task of that rate, whichever ticks the task's phase gives it.
    """

    ticks: int = 0
    """-; since boot"""
    time_us: int = -1
    """us; sensor time of the tick, -1 before the first"""
    dt: float = 0.005
    """s; since the last tick"""
    dt_100: float = 0.01
    """s; since the last turn of a 100 Hz task that is due now"""
    dt_50: float = 0.02
    """s; since the last turn of a 50 Hz task that is due now"""
    dt_20: float = 0.05
    """s; since the last turn of a 20 Hz task that is due now"""
    before_us: tuple[int, ...] = ()
    """us; sensor times of the `MEMORY` ticks before this one, the newest first"""


def first(time_us: int) -> Clock:
    """The first tick, every rate with its nominal step."""
    return Clock(0, time_us, before_us=tuple(time_us - NOMINAL_US * ago for ago in range(1, MEMORY + 1)))


_new_clock = constructor(Clock)


def advance(clock: Clock, time_us: int) -> Clock:
    """The next tick; ``time_us`` must be later than the last."""
    if clock.time_us < 0:
        return first(time_us)
    before = (clock.time_us, *clock.before_us[:-1])
    dt, dt_100 = step_of(before[0], time_us), step_of(before[1], time_us)
    dt_50, dt_20 = step_of(before[3], time_us), step_of(before[9], time_us)
    return _new_clock(clock.ticks + 1, time_us, dt, dt_100, dt_50, dt_20, before)


def step_of(last_us: int, time_us: int) -> float:
    """Seconds between two sensor times, at most `LONGEST_STEP`."""
    step = (time_us - last_us) * 1e-6
    return step if step < LONGEST_STEP else LONGEST_STEP
