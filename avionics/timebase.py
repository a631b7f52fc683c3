"""Time base: ticks of the sensor time, and time steps by rate."""

from __future__ import annotations

from typing import Final, NamedTuple

from wingbeat.records import constructor

BASE_RATE: Final = 200
"""Hz; sample rate of the IMU, one tick per sample"""
LONGEST_STEP: Final = 0.1
"""s; maximum time step of the loops after a gap in the sensor time"""
NOMINAL_US: Final = 1_000_000 // BASE_RATE
"""us; nominal period of a tick"""
MEMORY: Final = 10
"""-; number of stored tick times: one period of the slowest task rate with a time step, 20 Hz"""


class Clock(NamedTuple):
    """Tick count, and the present time step of each rate.

    The time step of a rate spans the number of ticks in its period. It is therefore the time since the last call of a
    task of that rate, for any phase of the task.
    """

    ticks: int = 0
    """-; ticks since boot"""
    time_us: int = -1
    """us; sensor time of the tick, -1 before the first"""
    dt: float = 0.005
    """s; time since the last tick"""
    dt_100: float = 0.01
    """s; time since the last call of a 100 Hz task that is due now"""
    dt_50: float = 0.02
    """s; time since the last call of a 50 Hz task that is due now"""
    dt_20: float = 0.05
    """s; time since the last call of a 20 Hz task that is due now"""
    before_us: tuple[int, ...] = ()
    """us; sensor times of the `MEMORY` previous ticks, newest first"""


def first(time_us: int) -> Clock:
    """Return the first tick, with the nominal time step of every rate."""
    return Clock(0, time_us, before_us=tuple(time_us - NOMINAL_US * ago for ago in range(1, MEMORY + 1)))


_new_clock: Final = constructor(Clock)


def advance(clock: Clock, time_us: int) -> Clock:
    """Return the next tick; ``time_us`` must be later than the last."""
    if clock.time_us < 0:
        return first(time_us)
    before = (clock.time_us, *clock.before_us[:-1])
    dt, dt_100 = step_of(before[0], time_us), step_of(before[1], time_us)
    dt_50, dt_20 = step_of(before[3], time_us), step_of(before[9], time_us)
    return _new_clock(clock.ticks + 1, time_us, dt, dt_100, dt_50, dt_20, before)


def step_of(last_us: int, time_us: int) -> float:
    """Return the time (s) between two sensor times, at most `LONGEST_STEP`."""
    step = (time_us - last_us) * 1e-6
    return step if step < LONGEST_STEP else LONGEST_STEP
