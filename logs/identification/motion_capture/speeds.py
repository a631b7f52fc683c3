"""Generalized speeds and their rates from coordinates (Grauer et al. 2011, Eq. 2 and the inverse of Eq. 3 to 6).

Coordinates are smoothed by a low-pass filter without delay (Grauer IV.C: 50 Hz at 500 Hz) and differentiated as the
cubic spline through them. Every derivative raises the noise with the cut-off frequency: by its power 1.5 in a speed,
2.5 in an acceleration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

from logs.identification.motion_capture.coordinates import Coordinates
from logs.identification.results import Array
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

CUTOFF = 50.0
"""Hz; Grauer IV.C"""
ORDER = 4
LONGEST_GAP = 0.02
"""s; without coordinates that is bridged by a spline; longer ones are refused"""


class Speeds(NamedTuple):
    """Coordinates of Eq. 1, speeds of Eq. 2 and their rates at N instants, smoothed."""

    time: Array
    """s; (N,)"""
    position_ned: Array
    """m; (N, 3)"""
    quaternion: Array
    """-; (N, 4), of r_ned_from_frd"""
    angles: Array
    """rad; (N, c)"""
    speeds: Array
    """m/s, rad/s; (N, 6 + c), velocity and angular velocity of the base in its axes, rates of the angles"""
    rates: Array
    """m/s^2, rad/s^2; (N, 6 + c), time derivatives of ``speeds``"""


def generalized_speeds(time: Array, found: Coordinates, cutoff: float = CUTOFF) -> Speeds:
    """Smoothed coordinates, speeds and rates at ``time`` (N,) s, equally spaced; ``cutoff`` in Hz.

    Raises:
        InputError: the record is too short for the filter or has gaps too long to bridge, or the cut-off is too high.
    """
    step = _step(time, cutoff)
    table = np.column_stack([found.position_ned, found.quaternion, found.angles])
    smooth = smoothed(bridged(time, table), step, cutoff)
    smooth[:, 3:7] /= np.linalg.norm(smooth[:, 3:7], axis=1, keepdims=True)
    spline = CubicSpline(time, smooth)
    first, second = spline(time, 1), spline(time, 2)
    quaternion = smooth[:, 3:7]
    to_body = dcms_from_quaternions(quaternion).swapaxes(1, 2)
    omega = 2.0 * _vector(quaternion, first[:, 3:7])
    v = np.einsum("nij,nj->ni", to_body, first[:, :3])
    v_rate = np.einsum("nij,nj->ni", to_body, second[:, :3]) - np.cross(omega, v)
    omega_rate = 2.0 * _vector(quaternion, second[:, 3:7])
    speeds = np.column_stack([v, omega, first[:, 7:]])
    return Speeds(
        time, smooth[:, :3], quaternion, smooth[:, 7:], speeds, np.column_stack([v_rate, omega_rate, second[:, 7:]])
    )


def smoothed(values: Array, step: float, cutoff: float) -> Array:
    """``values`` (N, k) low-passed without delay.

    The ends are filtered with the initial states by which forward and backward agree (Gustafsson 1996), so that no
    end is held to its own noise; the straight line through the record is left as it is.
    """
    x = np.linspace(-1.0, 1.0, len(values))[:, None]
    line = values.mean(axis=0) + x * (x * values).sum(axis=0) / float(np.sum(x * x))
    below, above = butter(ORDER, cutoff, fs=1.0 / step)
    return np.asarray(line + filtfilt(below, above, values - line, axis=0, method="gust"))


def bridged(time: Array, table: Array) -> Array:
    """``table`` (N, k) with the rows that are NaN filled by a spline.

    Raises:
        InputError: a gap is longer than `LONGEST_GAP`, or at an end.
    """
    known = np.asarray(np.isfinite(table).all(axis=1))
    at = np.flatnonzero(known)
    if len(at) < 4 or not (known[0] and known[-1]):
        raise InputError("the record begins or ends without coordinates: cut it to where its markers were seen")
    longest = float(np.max(np.diff(time[at])))
    if longest > LONGEST_GAP + 1.5 * (time[1] - time[0]):
        raise InputError(f"no coordinates for {longest:.3f} s: cut the record there ({LONGEST_GAP:g} s are bridged)")
    return table if known.all() else np.where(known[:, None], table, CubicSpline(time[at], table[at])(time))


def _step(time: Array, cutoff: float) -> float:
    steps = np.diff(time)
    if len(time) < 30 or not np.all(np.isfinite(steps)) or not np.ptp(steps) < 0.01 * np.mean(steps):
        raise InputError("speeds need a record of 30 frames or more, equally spaced in time")
    step = float(np.mean(steps))
    if not 0.0 < cutoff < 0.45 / step:
        raise InputError(f"a cut-off of {cutoff:g} Hz must lie below 0.45 of the frame rate {1.0 / step:g} Hz")
    return step


def _vector(quaternion: Array, rate: Array) -> Array:
    """Vector part of the conjugate of ``quaternion`` times ``rate``, (N, 3)."""
    w, v = quaternion[:, :1], quaternion[:, 1:]
    return np.asarray(w * rate[:, 1:] - rate[:, :1] * v - np.cross(v, rate[:, 1:]))
