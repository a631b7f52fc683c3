"""A flight's strokes as the filter takes them: what was measured of each, and which of those it computes are near.

Where derivatives swing with the wing, an average that always begins at one phase of the stroke sees them with the
motion's trend: the damping came out a tenth too high. Every stretch is therefore cut at two opposite phases, which
are wrong against each other, and both count half.
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from logs.identification.data.flight import Aircraft
from logs.identification.data.flight_segments import Stretch
from logs.identification.data.maneuvers import Reference, tail_angle
from logs.identification.estimators.flight.gust_filter import Averaged, Kinds
from logs.identification.estimators.flight.gusts import OUTPUTS, kinematics
from logs.identification.models.stroke_averaged import TAIL_LAG
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

PHASES = (0.0, 0.5)
"""-; of a stroke, at which the averages of the same flight begin"""
STEPS = 32
"""-; of the inputs through a stroke"""
LENGTH_STEP = 1e-2
"""-; of a mean stroke: strokes that differ by less share a transition"""
AIRSPEED_STEP, ANGLE_STEP = 1.0 / 8.0, 0.3
"""-, rad; of the reference's airspeed and of the angle of attack: what a stroke does is between what it would at the
steps on either side"""
BELIEVED = 0.25, 2.0
"""-; of the reference's airspeed, what a stroke may have"""
STEEPEST = 1.2
"""rad; angle of attack at the most"""


class Task(NamedTuple):
    """What is fitted to what."""

    stretches: tuple[Stretch, ...]
    """of every phase of `PHASES`, those of the first before the others"""
    reference: Reference
    aircraft: Aircraft
    names: tuple[str, ...]
    across: Array | None = None
    """m/s; (K,) through the air across the aircraft, in each stroke of all stretches in turn; None: not known, the
    angle of attack is the reference's"""

    @property
    def known_lag(self) -> bool:
        """Whether the tail's time constant is none of the parameters."""
        return TAIL_LAG not in self.names


def averaged_strokes(task: Task, lag: float | None) -> Averaged:
    """Every stroke of all stretches: airspeed, the tail's angle through it, and what else moves the aircraft."""
    aircraft = task.aircraft if lag is None else task.aircraft._replace(tail_time_constant=max(lag, 0.0))
    tails, aside, first = [], [], []
    share = np.arange(STEPS + 1) / STEPS
    for stretch in task.stretches:
        angle = tail_angle(stretch.time, stretch.command, aircraft)
        at = stretch.edges[:-1, None] + np.diff(stretch.edges)[:, None] * share
        tails.append(np.interp(at, stretch.time, angle))
        aside.append(_aside(stretch, at, task.reference))
        first.append(np.arange(len(stretch.edges) - 1) == 0)
    outputs = np.vstack([stretch.averages[:, : len(OUTPUTS)] for stretch in task.stretches])
    harder = np.broadcast_to(_harder(task)[:, None], (len(outputs), STEPS + 1))
    tail = np.vstack(tails)
    pushing = np.stack((tail, tail * _pressure_above(task)[:, None], harder), axis=1)
    inputs = np.concatenate((pushing, np.concatenate(aside)), axis=1)
    return Averaged(kinds_of(task), np.concatenate(first), inputs, outputs)


def _aside(stretch: Stretch, at: Array, reference: Reference) -> Array:
    """What bank and slip do at the times ``at`` (K, s) in s: (K, 4, s).

    To theta'; to w' by gravity; to u' and w' of a slip of 1 s times the side force, the other way.
    """
    roll, p, q, r, a_y = (np.interp(at, stretch.time, told) for told in stretch.sideways.T)
    lifted = STANDARD_GRAVITY * np.cos(reference.pitch) * (np.cos(roll) - 1.0)
    return np.stack((q * (np.cos(roll) - 1.0) - r * np.sin(roll), lifted, -r * a_y, p * a_y), axis=1)


def kinds_of(task: Task) -> Kinds:
    """Lengths, airspeeds and angles of attack at equal steps about those that occur, angles from the usual one."""
    durations = np.concatenate([np.diff(stretch.edges) for stretch in task.stretches])
    unit, reference = LENGTH_STEP * float(np.mean(durations)), task.reference
    usual = float(np.arctan2(reference.w, reference.u))
    steps = np.column_stack((_airspeeds(task) / AIRSPEED_STEP, (_angles(task, usual) - usual) / ANGLE_STEP))
    length, beyond = np.round(durations / unit), steps - np.floor(steps)
    corners, shares = [], []
    for further in product(*[(False, True) if np.any(axis) else (False,) for axis in beyond.T]):
        corners.append(np.column_stack((length, np.where(further, np.ceil(steps), np.floor(steps)))))
        shares.append(np.prod(np.where(further, beyond, 1.0 - beyond), axis=1))
    kinds, which = np.unique(np.vstack(corners), axis=0, return_inverse=True)
    lengths, airspeeds, angles = np.ascontiguousarray(kinds.T * [[unit], [AIRSPEED_STEP], [ANGLE_STEP]])
    turned = kinematics(reference, airspeeds * reference.airspeed, usual + angles)
    places = np.ascontiguousarray(which.reshape(len(corners), -1).T)
    return Kinds(lengths, airspeeds, turned, places, np.column_stack(shares))


def _airspeeds(task: Task) -> Array:
    """Times the reference's (K,). Outside of `BELIEVED` a pitot is blocked or was disturbed: the reference's then."""
    airspeed = np.concatenate([stretch.airspeed for stretch in task.stretches]) / task.reference.airspeed
    low, high = BELIEVED
    return np.where((airspeed > low) & (airspeed < high), airspeed, 1.0)


def _angles(task: Task, usual: float) -> Array:
    """Angle of attack (K,) in rad; the ``usual`` where it is not known of each stroke."""
    if task.across is None:
        return np.full(sum(len(stretch.airspeed) for stretch in task.stretches), usual)
    sine = task.across / (_airspeeds(task) * task.reference.airspeed)
    angles: Array = np.arcsin(np.clip(sine, -np.sin(STEEPEST), np.sin(STEEPEST)))
    return angles


def _pressure_above(task: Task) -> Array:
    """By how much of the reference's the dynamic pressure is above it in each stroke (K,)."""
    above: Array = _airspeeds(task) ** 2 - 1.0
    return above


def _harder(task: Task) -> Array:
    """By how much of its mean the mean square of the wings' rate is above it, in each stroke (K,); 0 where
    it was not measured."""
    squared = np.concatenate([stretch.wing_rate_squared for stretch in task.stretches])
    mean = float(np.mean(squared))
    return squared / mean - 1.0 if mean > 0.0 else squared
