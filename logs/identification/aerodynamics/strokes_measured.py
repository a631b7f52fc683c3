"""Strokes of a wing from its angle, the stream and the force that was measured, ready for Malladi's Eq. 19.

A flat wing that flaps by ``flap`` about an axis along the body's x axis, in a stream of airspeed V at the angle of
attack alpha: a section at the distance y from that axis moves through the air by V cos(alpha) along the chord and by
y flap' - V sin(alpha) cos(flap) along the wing's normal. Lift and drag of both wings add up along the body's x axis
and, by cos(flap), along its z axis; what they do sideways cancels.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from avionics.quantities import BadInput
from logs.identification.results import Array
from logs.strokes import strokes_of, time_at
from sim_bridge.aerodynamics.stroke_averages import StrokeRecord, stroke_record

INSTANTS = 128
"""-; of a stroke, between samples by cubic splines"""
LEAST_PER_STROKE = 8.0
"""-; samples of a stroke that a spline can follow"""
STRIPS = 20
"""-; that a planform is cut into"""


class Planform(NamedTuple):
    """One wing, cut into sections."""

    distance: Array
    """m; (n,), of each section's middle from the flapping axis"""
    area: Array
    """m^2; (n,)"""


class Flapped(NamedTuple):
    """What was measured of flapping wings, N equally spaced instants, NaN where nothing was."""

    time: Array
    """s; (N,)"""
    flap: Array
    """rad; (N,), of both wings, wing up positive"""
    airspeed: Array
    """m/s; (N,)"""
    alpha: Array
    """rad; (N,), of the body's x axis to the stream, nose up"""
    force: Array
    """N; (N, 2), of the air on the wings, forward along the body's x axis and up against its z axis"""
    density: float
    """kg/m^3"""
    wings: int = 2
    """-; that the force is of"""


class MeasuredStrokes(NamedTuple):
    """Whole strokes of one record."""

    begin: Array
    """s; (M,)"""
    end: Array
    """s; (M,)"""
    records: tuple[StrokeRecord, ...]
    forces: tuple[Array, ...]
    """(N, 2) N of each stroke; forward and up, body axes"""


def planform_of(outline: tuple[tuple[float, float], ...]) -> Planform:
    """Sections of a wing from its ``outline``: pairs of distance from the flapping axis and chord there, m, rising.

    Raises:
        BadInput: fewer than two pairs, distances that do not rise from 0 on, a chord below zero, or no area.
    """
    table = np.asarray(outline, dtype=np.float64).reshape(-1, 2)
    if len(table) < 2 or np.any(np.diff(table[:, 0]) <= 0) or table[0, 0] < 0:
        raise BadInput("a planform is two pairs or more of distance from the flapping axis (m, rising) and chord")
    if np.any(table[:, 1] < 0) or not np.any(table[:, 1] > 0):
        raise BadInput("a planform's chords (m) are 0 or more, and one above 0")
    edges = np.linspace(table[0, 0], table[-1, 0], STRIPS + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    return Planform(middles, np.interp(middles, table[:, 0], table[:, 1]) * np.diff(edges))


def strokes_by_angle(time: Array, flap: Array) -> tuple[Array, Array]:
    """Begins and ends (M,) in s of whole strokes: from one upward pass of the stroke's middle to the next.

    A gap in the angle ends a stroke that nobody knows the end of.
    """
    known = np.isfinite(flap)
    if known.sum() < 2:
        return np.zeros(0), np.zeros(0)
    middle = float(np.quantile(flap[known], 0.95) + np.quantile(flap[known], 0.05)) / 2
    reach = float(np.quantile(flap[known], 0.95) - np.quantile(flap[known], 0.05)) / 4
    cuts, low = [], False
    for at in range(1, len(flap)):
        if not (known[at] and known[at - 1]):
            cuts.append(np.nan)
            low = False
            continue
        low = low or flap[at - 1] < middle - reach
        if low and flap[at - 1] < middle <= flap[at]:
            share = (middle - flap[at - 1]) / (flap[at] - flap[at - 1])
            cuts.append(time[at - 1] + share * (time[at] - time[at - 1]))
            low = False
    begin, end = np.array(cuts[:-1]), np.array(cuts[1:])
    whole = np.isfinite(begin) & np.isfinite(end)
    return begin[whole], end[whole]


def strokes_by_count(time: Array, count: Array) -> tuple[Array, Array]:
    """Begins and ends (M,) in s of whole strokes by a ``count`` (N,) that rises by 1 in each."""
    known = np.isfinite(count)
    if known.sum() < 2:
        return np.zeros(0), np.zeros(0)
    strokes = strokes_of(2 * np.pi * count[known])
    cuts = time_at(time[known], strokes, np.arange(np.ceil(strokes[0]), np.floor(strokes[-1]) + 1))
    return cuts[:-1], cuts[1:]


def measured_strokes(flown: Flapped, wing: Planform, cuts: tuple[Array, Array]) -> MeasuredStrokes:
    """The strokes between ``cuts`` (begins and ends, s) of which every sample was measured.

    Raises:
        BadInput: too few samples to a stroke.
    """
    columns = np.column_stack((flown.flap, flown.airspeed, flown.alpha, flown.force))
    records, forces, spans = [], [], []
    step = float(flown.time[-1] - flown.time[0]) / (len(flown.time) - 1)
    for begin, end in zip(*cuts, strict=True):
        if (end - begin) / step < LEAST_PER_STROKE:
            raise BadInput(
                f"a stroke has {(end - begin) / step:.1f} samples; {LEAST_PER_STROKE:g} are needed to follow it"
            )
        near = (flown.time >= begin - 3 * step) & (flown.time <= end + 3 * step)
        if np.all(np.isfinite(columns[near])):
            record, force = _stroke(flown, near, (begin, end), wing)
            records.append(record)
            forces.append(force)
            spans.append((begin, end))
    table = np.array(spans, dtype=np.float64).reshape(-1, 2)
    return MeasuredStrokes(table[:, 0], table[:, 1], tuple(records), tuple(forces))


def _stroke(
    flown: Flapped, near: NDArray[np.bool_], span: tuple[float, float], wing: Planform
) -> tuple[StrokeRecord, Array]:
    """Pressures of Eq. 19 along the body's x and z axes, and the force, of one stroke.

    Between samples of different halves the force is that of the half's own last: what it does at a reversal is not
    shared out between two coefficients.
    """
    time, period = flown.time[near], span[1] - span[0]
    curve = CubicSpline(time, np.column_stack((flown.flap, flown.airspeed, flown.alpha))[near])
    at = span[0] + period * np.arange(INSTANTS) / INSTANTS
    (flap, airspeed, alpha), rate = curve(at).T, curve(at, 1)[:, 0]
    along = np.broadcast_to((airspeed * np.cos(alpha))[:, None], (len(flap), len(wing.distance)))
    normal = rate[:, None] * wing.distance - (airspeed * np.sin(alpha) * np.cos(flap))[:, None]
    plane = stroke_record(period, np.stack([along, normal], axis=2), wing.area, flown.density, rate < 0.0)
    turned = flown.wings * np.column_stack((np.ones(len(flap)), np.cos(flap)))
    record = plane._replace(lift_pressure=plane.lift_pressure * turned, drag_pressure=plane.drag_pressure * turned)
    return record, _by_half(at, plane.down, time, curve(time, 1)[:, 0] < 0.0, flown.force[near])


def _by_half(at: Array, down: NDArray[np.bool_], time: Array, sampled_down: NDArray[np.bool_], force: Array) -> Array:
    """Force (M, 2) at the instants ``at`` (s; M,), between samples (N, 2) of the same half of the stroke."""
    told = np.empty((len(at), 2))
    for half in (False, True):
        own = sampled_down == half
        if not own.any():
            return np.full((len(at), 2), np.nan)
        for axis in range(2):
            told[down == half, axis] = np.interp(at[down == half], time[own], force[own, axis])
    return told
