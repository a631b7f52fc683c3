"""Task tables of the four processors, and the schedule of the ticks.

The division is that of the Robo Raven II suite (Gerdes 2017, Fig. 1): one microcontroller for attitude, one for the
power ADC, one for everything else, one for the log. Here they share one thread; each task belongs to one of them,
runs at its rate, and is timed with it. To add a task, write it in `tasks` and enter it in a table.

A tick has a deadline, so that tasks are distributed over the ticks: the phase selects the ticks of a task within the
period of its rate. The bridge delivers an ADC burst in every second tick and a pressure sample, which advances two
filters, in every fourth. The order remains estimate, guide, stabilize, over several ticks instead of one. The
altitude and heading loops use the new estimate in its tick; the attitude loops use their setpoints in the next one.
In the third tick the wings and the tail are checked. In the fourth tick modes and navigation update the setpoints of
the next round. Tasks with a rate of 1 Hz or less have a tick without any of these except the checks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import IntEnum
from itertools import groupby
from math import lcm
from typing import Final, NamedTuple

from avionics import topics
from avionics.messages import TaskTiming
from avionics.state import AutopilotState
from avionics.tasks import calibrate, estimate, guide, mix, report, sense, stabilize
from avionics.timebase import BASE_RATE
from wingbeat.topic import Publish

Run = Callable[[AutopilotState, Publish], None]


class Part(IntEnum):
    """Parts of a tick in order of execution."""

    SENSE = 0
    ESTIMATE = 1
    GUIDE = 2
    STABILIZE = 3
    MIX = 4
    REPORT = 5


class Processor(IntEnum):
    """Processors, as numbered in `TaskTiming`."""

    ATTITUDE = 0
    POWER = 1
    MAIN = 2
    LOGGER = 3


WHOLE_TICK: Final = len(Processor)
"""Index in `TaskTiming` after the processors: the whole tick from the arrival of a frame, including the ground links.
"""


class Task(NamedTuple):
    """Row of the table of a processor."""

    part: Part
    """-; part of the tick"""
    rate: float
    """Hz; divides the base rate. A task of a slow sensor runs in every tick and returns if there is no sample"""
    phase: int
    """-; first tick, less than the period in ticks"""
    run: Run
    """the task"""


ATTITUDE = (
    Task(Part.ESTIMATE, 200.0, 0, estimate.attitude),
)  # fmt: skip
POWER = (
    Task(Part.SENSE, 200.0, 0, sense.power),
)  # fmt: skip
MAIN = (
    Task(Part.SENSE, 200.0, 0, sense.wing),
    Task(Part.SENSE, 200.0, 0, sense.air),
    Task(Part.SENSE, 200.0, 0, sense.torque),
    Task(Part.SENSE, 200.0, 0, sense.vibrations),
    Task(Part.SENSE, 200.0, 0, calibrate.calibrate),
    Task(Part.SENSE, 200.0, 0, sense.pilot),
    Task(Part.SENSE, 50.0, 2, sense.wings),
    Task(Part.SENSE, 50.0, 2, sense.tail),
    Task(Part.ESTIMATE, 200.0, 0, estimate.altitude),
    Task(Part.ESTIMATE, 200.0, 0, estimate.position),
    Task(Part.GUIDE, 50.0, 3, guide.modes),
    Task(Part.GUIDE, 20.0, 3, guide.navigation),
    Task(Part.GUIDE, 100.0, 1, guide.excitation),
    Task(Part.GUIDE, 50.0, 0, guide.vertical),
    Task(Part.GUIDE, 50.0, 0, guide.lateral),
    Task(Part.STABILIZE, 100.0, 1, stabilize.pitch),
    Task(Part.STABILIZE, 100.0, 1, stabilize.roll),
    Task(Part.MIX, 200.0, 0, mix.mix),
)  # fmt: skip
LOGGER = (
    Task(Part.REPORT, 100.0, 1, report.report_excitation),
    Task(Part.REPORT, 1.0, 6, report.report_health),
    Task(Part.REPORT, 0.1, 10, report.report_snapshot),
)  # fmt: skip
PROCESSORS: Final[dict[Processor, tuple[Task, ...]]] = {
    Processor.ATTITUDE: ATTITUDE,
    Processor.POWER: POWER,
    Processor.MAIN: MAIN,
    Processor.LOGGER: LOGGER,
}

Runs = tuple[Run, ...]


class Due(NamedTuple):
    """Tasks due in one tick, by part, in the order of the tables."""

    sense: Runs
    estimate: Runs
    guide: Runs
    stabilize: Runs
    mix: Runs
    report: Runs


Row = tuple[Processor, Task]
Group = Callable[[Sequence[Row]], Runs]


def plain(rows: Sequence[Row]) -> Runs:
    """Return the tasks of one part without timing."""
    return tuple(task.run for _, task in rows)


def build_schedule(processors: dict[Processor, tuple[Task, ...]], group: Group = plain) -> tuple[Due, ...]:
    """Return the tasks due in each tick of the periodic schedule.

    Raises:
        ValueError: a rate that does not divide the base rate, or a phase beyond the ticks of its rate.
    """
    rows = [(_turn(task), (processor, task)) for processor, table in processors.items() for task in table]
    turns = {turn for turn, _ in rows}
    made: dict[frozenset[Turn], Due] = {}
    schedule = []
    for tick in range(lcm(*(turn.every for turn in turns))):
        now = frozenset(turn for turn in turns if tick % turn.every == turn.phase)
        if now not in made:
            made[now] = _due([row for turn, row in rows if turn in now], group)
        schedule.append(made[now])
    return tuple(schedule)


class Turn(NamedTuple):
    """Period and phase of a task in ticks."""

    every: int
    """-; period in ticks"""
    phase: int
    """-; first tick"""


def _turn(task: Task) -> Turn:
    every = round(BASE_RATE / task.rate)
    if every < 1 or every * task.rate != BASE_RATE:
        raise ValueError(f"task rates must divide {BASE_RATE} Hz")
    if not 0 <= task.phase < every:
        raise ValueError(f"a task of {task.rate:g} Hz has a phase from 0 to {every - 1}, not {task.phase}")
    return Turn(every, task.phase)


def _due(rows: list[Row], group: Group) -> Due:
    return Due(*(group([row for row in rows if row[1].part == part]) for part in Part))


SCHEDULE: Final[tuple[Due, ...]] = build_schedule(PROCESSORS)


def run(due: Runs, s: AutopilotState, publish: Publish) -> None:
    """Run tasks in order."""
    for task in due:
        task(s, publish)


class Stopwatch:
    """Measurement of the run times of the processors, outside the deterministic core.

    Pass `schedule` to the `Autopilot` and call `tick` after each of its steps. Once a second of sensor time it
    publishes one `TaskTiming` for each processor. If `begin` is called at the arrival of a frame, and `tick` after
    all work of a tick, one more is published for the whole tick (`WHOLE_TICK`). Only this one includes the ground
    links.
    """

    def __init__(self, clock_ns: Callable[[], int]) -> None:
        """Set the clock, for example ``time.perf_counter_ns``."""
        self._clock = clock_ns
        self._spent = [0] * (WHOLE_TICK + 1)
        self._total = [0] * (WHOLE_TICK + 1)
        self._worst = [0] * (WHOLE_TICK + 1)
        self._overruns = [0] * (WHOLE_TICK + 1)
        self._ticks = 0
        self._start_us = -1
        self._arrived: int | None = None
        self.schedule = build_schedule(PROCESSORS, self._timed)

    def _timed(self, rows: Sequence[Row]) -> Runs:
        """Return the tasks with timing; adjacent tasks of a processor are timed together."""
        neighbours = groupby(rows, key=lambda row: row[0])
        return tuple(self._around(processor, plain(list(group))) for processor, group in neighbours)

    def _around(self, processor: Processor, runs: Runs) -> Run:
        clock, spent, index = self._clock, self._spent, int(processor)

        def timed(s: AutopilotState, publish: Publish) -> None:
            began = clock()
            for task in runs:
                task(s, publish)
            spent[index] += clock() - began

        return timed

    def begin(self) -> None:
        """Mark the arrival of a sensor frame."""
        self._arrived = self._clock()

    def tick(self, time_us: int, publish: Publish) -> None:
        """Close the tick; publish and reset after each second of sensor time."""
        if self._arrived is not None:
            self._spent[WHOLE_TICK] = self._clock() - self._arrived
        period_ns = 1_000_000_000 // BASE_RATE
        for i, spent in enumerate(self._spent):
            self._total[i] += spent
            self._worst[i] = max(self._worst[i], spent)
            self._overruns[i] += spent > period_ns
            self._spent[i] = 0
        self._ticks += 1
        if self._start_us < 0:
            self._start_us = time_us
        if time_us - self._start_us >= 1_000_000:
            self._publish(time_us, publish)

    def _publish(self, time_us: int, publish: Publish) -> None:
        for i in range(WHOLE_TICK if self._arrived is None else WHOLE_TICK + 1):
            mean, worst = self._total[i] / self._ticks * 1e-3, self._worst[i] * 1e-3
            publish(topics.TIMING, TaskTiming(time_us, i, mean, worst, self._overruns[i]))
            self._total[i] = self._worst[i] = self._overruns[i] = 0
        self._ticks, self._start_us = 0, time_us
