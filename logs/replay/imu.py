"""Replay of IMU recordings through the attitude filter, with errors.

The recordings are trials of BROAD (D. Laidig, M. Caruso, A. Cereatti, T. Seel, "BROAD - A Benchmark for Robust
Inertial Orientation Estimation", Data 6(7):72, 2021), as ``.npz`` with the keys ``gyr`` (rad/s), ``acc`` (m/s^2,
specific force), ``mag`` (uT), all of shape (n, 3), ``quat`` (n, 4), sensor to East-North-Up as (w, x, y, z) with NaN
where the reference was lost, ``movement`` (n,), not 0 where a sample counts, and ``rate`` (Hz).
"""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from math import sqrt
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.estimation import ahrs
from avionics.messages import ImuSample
from wingbeat.errors import InputError

Array = NDArray[np.float64]

GAUSS_PER_MICROTESLA = 0.01
ENU_FROM_NED = (0.0, sqrt(0.5), sqrt(0.5), 0.0)
"""-; quaternion (w, x, y, z) that swaps north and east and reverses down"""
LONGEST_GAP = ahrs.LONGEST_STEP
"""s; longest gap without a finite sensor sample that the filter bridges"""
METHODS = {"averages": ahrs.AVERAGES, "razor": ahrs.RAZOR}
"""values of `ahrs.AhrsGains.method`"""
SENSORS = ("gyr", "acc", "mag")
SHAPES = {"gyr": (3,), "acc": (3,), "mag": (3,), "quat": (4,), "movement": ()}


class ImuScore(NamedTuple):
    """Orientation error of one recording, RMS over the scored samples."""

    file: str
    """-; name of the recording"""
    total_deg: float
    """deg; angle of the rotation between estimate and reference"""
    heading_deg: float
    """deg; of its component about the vertical"""
    inclination_deg: float
    """deg; of its component about a horizontal axis"""


class Recording(NamedTuple):
    """Recording as read."""

    path: Path
    rate: float
    """Hz"""
    sensors: Array
    """shape (n, 9): accelerometer in m/s^2, gyroscope in rad/s, magnetometer in gauss, sensor axes"""
    reference: Array
    """shape (n, 4): quaternion sensor to ENU (w, x, y, z), NaN if not tracked"""
    counts: NDArray[np.bool_]
    """shape (n,): mask of the scored samples"""


class Errors(NamedTuple):
    """Orientation errors in rad, each of shape (n,)."""

    total: Array
    heading: Array
    inclination: Array


def replay_imu(
    paths: Iterable[str | Path],
    gains: ahrs.AhrsGains | None = None,
    scored: Callable[[ImuScore], None] | None = None,
) -> list[ImuScore]:
    """Score the recordings at ``paths``; a folder stands for all its ``.npz`` files by name.

    Args:
        paths: files or folders.
        gains: of the attitude filter (default: `AhrsGains()`).
        scored: called with each score.

    Raises:
        InputError: no such file, no recording in it, or a recording that cannot be scored.
    """
    chosen = ahrs.AhrsGains() if gains is None else gains
    scores: list[ImuScore] = []
    for path in recordings(paths):
        score = score_recording(load_recording(path), chosen)
        scores.append(score)
        if scored is not None:
            scored(score)
    return scores


def recordings(paths: Iterable[str | Path]) -> list[Path]:
    """Return the files of ``paths``.

    Raises:
        InputError: a path that does not exist, a folder without recordings, or no path.
    """
    files: list[Path] = []
    for path in map(Path, paths):
        if path.is_dir():
            inside = sorted(path.glob("*.npz"))
            if not inside:
                raise InputError(f"{path}: no .npz recording in this folder")
            files += inside
        elif path.exists():
            files.append(path)
        else:
            raise InputError(f"{path}: no such file or folder")
    if not files:
        raise InputError("no IMU recording given")
    return files


def load_recording(path: Path) -> Recording:
    """Read and check one recording.

    Raises:
        InputError: not a BROAD ``.npz``; the message has the reason.
    """
    arrays = _arrays(path)
    rate = _rate(path, arrays["rate"])
    samples = len(arrays["gyr"]) if arrays["gyr"].ndim else 0
    if samples < 2:
        raise InputError(f"{path}: no samples in it")
    for key, rest in SHAPES.items():
        if arrays[key].shape != (samples, *rest):
            expected = (samples, *rest)
            raise InputError(f"{path}: {key} has shape {arrays[key].shape}, expected {expected}")
    acc, gyr, mag = arrays["acc"], arrays["gyr"], arrays["mag"] * GAUSS_PER_MICROTESLA
    sensors = np.concatenate([acc, gyr, mag], axis=1)
    _check_gaps(path, sensors, rate)
    counts = (np.nan_to_num(arrays["movement"]) != 0) & np.isfinite(arrays["quat"]).all(axis=1)
    if not counts.any():
        raise InputError(f"{path}: no sample has movement flagged and a finite reference")
    return Recording(path, rate, sensors, arrays["quat"], counts)


def _arrays(path: Path) -> dict[str, Array]:
    keys = (*SHAPES, "rate")
    try:
        archive = np.load(path, allow_pickle=False)
        if not isinstance(archive, np.lib.npyio.NpzFile):
            raise InputError(f"{path}: one array, not an .npz archive of {', '.join(keys)}")
        with archive:
            missing = [key for key in keys if key not in archive]
            if missing:
                raise InputError(f"{path}: no {', '.join(missing)} in it; a recording has {', '.join(keys)}")
            return {key: np.asarray(archive[key], dtype=float) for key in keys}
    except InputError:
        raise
    except (OSError, EOFError, ValueError, TypeError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        reason = (
            error.strerror if isinstance(error, OSError) and error.strerror else "no NumPy archive, or a damaged one"
        )
        raise InputError(f"{path}: not a readable .npz recording: {reason}") from None


def _rate(path: Path, rate: Array) -> float:
    if rate.size != 1 or not 10.0 <= float(rate.reshape(-1)[0]) <= 10000.0:
        raise InputError(f"{path}: rate must be one number between 10 and 10000 Hz")
    return float(rate.reshape(-1)[0])


def _check_gaps(path: Path, sensors: Array, rate: float) -> None:
    """Reject sensors that are not finite at the start or for longer than the filter bridges."""
    finite: NDArray[np.bool_] = np.asarray(np.isfinite(sensors).all(axis=1))
    if not finite[0]:
        raise InputError(f"{path}: the first sensor sample is not finite")
    good = np.flatnonzero(finite)
    edges = np.append(good, len(finite))
    gap = int(np.argmax(np.diff(edges)))
    length = (int(edges[gap + 1]) - int(edges[gap]) - 1) / rate
    if length > LONGEST_GAP:
        start = (int(edges[gap]) + 1) / rate
        raise InputError(f"{path}: sensors are not finite for {length:.2f} s from {start:.2f} s on")


def score_recording(recording: Recording, gains: ahrs.AhrsGains) -> ImuScore:
    """Run the filter over a recording and score it, without alignment, offset or time shift."""
    estimate = orientations(recording, gains)
    errors = orientation_errors(estimate, recording.reference)
    total, heading, inclination = (
        float(np.degrees(np.sqrt(np.mean(error[recording.counts] ** 2)))) for error in errors
    )
    return ImuScore(recording.path.name, total, heading, inclination)


def orientations(recording: Recording, gains: ahrs.AhrsGains) -> Array:
    """Return the filter's quaternions sensor to NED, converted to ENU (w, x, y, z), shape (n, 4)."""
    state: ahrs.AhrsState | None = None
    estimate: list[tuple[float, float, float, float]] = []
    for k, values in enumerate(recording.sensors.tolist()):
        imu = ImuSample(round(k * 1e6 / recording.rate), *values)
        if state is None:
            state = ahrs.start(gains, imu)
            attitude = ahrs.attitude(state)
        else:
            state, attitude = ahrs.step(gains, state, imu)
        estimate.append(attitude.quaternion)
    return multiply(np.array([ENU_FROM_NED]), np.array(estimate))


def multiply(a: Array, b: Array) -> Array:
    """Multiply quaternions (w, x, y, z), shape (n, 4)."""
    w, x, y, z = a.T
    p, q, r, s = b.T
    return np.stack(
        [
            w * p - x * q - y * r - z * s,
            w * q + x * p + y * s - z * r,
            w * r - x * s + y * p + z * q,
            w * s + x * r - y * q + z * p,
        ],
        axis=1,
    )


def orientation_errors(estimate: Array, reference: Array) -> Errors:
    """Compute the errors between quaternions to the same earth frame with z vertical, shape (n, 4) each.

    BROAD's metric: with ``q = q_est * q_ref^-1``, total = 2 acos|w|, heading = 2 atan|z / w|, inclination =
    2 acos sqrt(w^2 + z^2).
    """
    w, _, _, z = multiply(estimate, reference * np.array([1.0, -1.0, -1.0, -1.0])).T
    upright = np.hypot(w, z)
    return Errors(
        2.0 * np.arccos(np.clip(np.abs(w), 0.0, 1.0)),
        2.0 * np.arctan2(np.abs(z), np.abs(w)),
        2.0 * np.arccos(np.clip(upright, 0.0, 1.0)),
    )


def means(scores: Sequence[ImuScore]) -> ImuScore:
    """Return the mean of the scores (at least one), under the name ``mean``."""
    total, heading, inclination = (float(np.mean([score[k] for score in scores])) for k in (1, 2, 3))
    return ImuScore("mean", total, heading, inclination)


def rows(scores: Sequence[ImuScore]) -> list[dict[str, Any]]:
    """Return the scores as rows for JSON."""
    return [score._asdict() for score in scores]
