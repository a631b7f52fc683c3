"""Classification of the outcome of a flight with its reason."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from avionics import topics
from avionics.guidance.modes import Gains
from avionics.messages import Stage
from logs.columns import Columns
from logs.summary import FlightSummary
from sim_bridge.topics import STATE


class Outcome(StrEnum):
    """Outcome of a flight."""

    LANDED = "landed"
    AIRBORNE = "airborne"
    """time limit reached before ground contact"""
    CRASHED = "crashed"
    ASTRAY = "astray"
    """outside the fence of the flight computer"""
    NOT_LAUNCHED = "not launched"
    NOT_A_NUMBER = "not a number"
    REFUSED = "refused"
    """its values cannot be combined"""
    ERROR = "error"
    """exception in the simulation"""
    KILLED = "killed"
    """process ended from outside"""


FINE = (Outcome.LANDED, Outcome.AIRBORNE)
"""Outcomes without failure."""


class Evaluation(NamedTuple):
    """Evaluation of a flight."""

    outcome: Outcome
    reason: str = ""
    """one line; empty if the flight did not fail"""

    @property
    def failed(self) -> bool:
        """Whether the flight counts as failed."""
        return self.outcome not in FINE


class Landing(NamedTuple):
    """Limits of a touchdown, beyond which it is a crash."""

    sink: float = 2.0
    """m/s"""
    bank: float = math.radians(30.0)
    """rad; of either sign"""


class Judged(NamedTuple):
    """Data to evaluate a flight."""

    summary: FlightSummary
    tables: Mapping[str, Columns]
    fence: Gains
    """fence of the flight computer"""
    landing: Landing
    by_hand: bool
    """whether a transmitter controlled the flight: the vehicle may then land in any stage"""


def judge(flight: Judged) -> Evaluation:
    """Evaluate a flight whose numbers are finite."""
    summary = flight.summary
    if summary.launch is None:
        return Evaluation(Outcome.NOT_LAUNCHED, f"not launched within {summary.log_duration:.0f} s")
    away, fence = farthest(flight.tables[STATE.name]), flight.fence
    if away > fence.fence_radius or (summary.highest or 0.0) > fence.fence_altitude:
        return Evaluation(
            Outcome.ASTRAY, f"out of the fence, {away:.0f} m away, up to {summary.highest or 0.0:.0f} m"
        )
    if summary.touchdown is None:
        return Evaluation(Outcome.AIRBORNE)
    reason = _crash(flight)
    return Evaluation(Outcome.CRASHED, reason) if reason else Evaluation(Outcome.LANDED)


def farthest(truth: Columns) -> float:
    """Return the largest horizontal distance from the launch position in m."""
    return float(np.hypot(truth["north"], truth["east"]).max())


def _crash(flight: Judged) -> str:
    """Return why a touchdown was a crash; empty for a landing."""
    touchdown = flight.summary.touchdown
    assert touchdown is not None
    stage = _stage(flight.tables, touchdown.time)
    if stage not in (None, Stage.APPROACH, Stage.FLARE) and not flight.by_hand:
        return f"on the ground in {Stage(stage).name}"
    bank = abs(touchdown.bank)
    if touchdown.sink > flight.landing.sink or bank > flight.landing.bank:
        return f"touchdown with {touchdown.sink:.1f} m/s sink and {math.degrees(bank):.0f} deg bank"
    return ""


def _stage(tables: Mapping[str, Columns], time: float) -> int | None:
    """Return the stage of the flight before ``time`` s; None if it was not recorded."""
    navigation: Any = tables.get(topics.NAVIGATION.name)
    if navigation is None:
        return None
    row = int(np.searchsorted(navigation.time, time - 1e-6)) - 1
    return int(navigation["stage"][max(row, 0)])
