"""An IMU's errors by the ground velocities of a GPS receiver: no attitude need be measured.

An attitude filter's pitch and bank rest on the very gyros that are in question, and what is wrong with them drifts
more slowly than a record lasts. So they are left out here. Rates and specific forces carry velocity and attitude from
fix to fix (`rigid_motion`); a rate that is wrong turns gravity, and the velocity runs away with the square of time.
What carries them is known only so well: its noise, the walk of its offsets and the noise of the fixes are found by
the likelihood, scales, misalignments and a lag of the accelerometers within what is usual.

An extended Kalman filter and the smoother of Rauch, Tung & Striebel, repeated about the smoothed path (Bell, The
Iterated Kalman Smoother as a Gauss-Newton Method, SIAM J. Optimization 4(3), 1994), give the optimum; the errors as
in Groves, Principles of GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., chapter 14.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from logs.identification.data.noise_level import noise_level
from logs.identification.estimators.gps_aided_kernels import (
    LAG,
    MATRICES,
    MOTION,
    OFFSETS,
    UNKNOWNS,
    Chain,
    filtered,
    over_interval,
)
from logs.identification.models.rigid_body import flown, linearised, with_middles
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

FIRST = np.array([3.0] * 3 + [0.2] * 2 + [0.5] + [0.2] * 3 + [1.0] * 3 + [0.01] * 9 + [0.007] * 9 + [0.003])
"""SI; standard deviations before the first fix. Motion: of the first guess; offsets: wider than they may come out;
scales and misalignments: 1 % and 0.6 deg of gyros, 0.7 % and 0.4 deg of accelerometers (`AhrsGains.level_error`);
half a sample of lag either way, means over a sample beside readings"""
WALKS = (3e-4, 1e-3)
"""rad/s^1.5, m/s^2.5; usual walks of the offsets: warming, and what a scale's error does in and out of turns"""
FIX_NOISE = 0.1
"""m/s; of a receiver's velocity"""
LEAST_NOISE = (1e-4, 1e-3)
"""rad/s, m/s^2; of a sample, where no noise is seen"""
LEAST_FIX_NOISE = 0.01
"""m/s; to which a receiver tells its velocity"""
FACTORS = np.array([1.0, 1.0, 1.0, 1.0, 5.0])
"""-; standard deviation of the levels' logarithms about the usual ones"""
ROUNDS, TUNED = 12, (1, 3)
"""-; times that the path is improved, at the most, and before which of them the levels are found anew"""
CONVERGED = 0.1
"""-; largest step of the motion, in standard errors"""
SHIFT = 1e-5
"""SI; either way, of the slopes of what the fixes tell"""


class AidedFlight(NamedTuple):
    """A stretch of flight as an IMU and a GPS receiver told it."""

    time: Array
    """s; (N,), even"""
    inputs: Array
    """rad/s, m/s^2; (N, 6), as `rigid_motion.INPUTS`"""
    attitude: Array
    """rad; (N, 3), phi, theta, psi, to begin with only"""
    at: Array
    """-; (K,), samples that the fixes tell of, rising, whole numbers"""
    velocity: Array
    """m/s; (K, 3), NED over ground"""
    arm: tuple[float, float, float]
    """m; from the receiver's antenna, or the centre of mass, to the IMU, FRD"""

    @property
    def step(self) -> float:
        """s; between samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


class Levels(NamedTuple):
    """How much noise there is."""

    rates: float
    """rad/s; of a sample"""
    forces: float
    """m/s^2; of a sample"""
    rate_walk: float
    """rad/s^1.5; of the rates' offsets"""
    force_walk: float
    """m/s^2.5; of the forces' offsets"""
    fixes: float
    """m/s; of a fix, each axis"""


class AidedFit(NamedTuple):
    """What is wrong with the IMU, and how it moved."""

    errors: Array
    """rad/s, m/s^2; (6,), mean over the stretch of what each input told too much, scales and all"""
    covariance: Array
    """(6, 6); of these"""
    motion: Array
    """m/s, rad; (K, 6), u, v, w over ground and phi, theta, psi at the fixes"""
    told: Array
    """m/s; (K, 3), velocities of the smoothed path, as the fixes should tell them"""
    levels: Levels


class _Linear(NamedTuple):
    """The flight about a path (K, 31), interval by interval."""

    over: Array
    shifts: Array
    spread: Array
    """(K - 1, 2, 6, 6); by noise of 1 of rates and forces"""
    seconds: Array
    sums: Array
    grown: Array
    slopes: Array
    left: Array


def aided_fit(flight: AidedFlight) -> AidedFit | None:
    """The smoothed path and the mean errors of the inputs; None where the repetitions do not settle."""
    path = _first_path(flight)
    first, levels = path[0].copy(), usual_levels(flight)
    for number in range(ROUNDS):
        linear = _linear(flight, path)
        if number in TUNED:
            levels = _likeliest(linear, first - path[0], levels, usual_levels(flight))
        means, covariances = _forward(linear, first - path[0], levels)
        steps = _backward(linear, means, covariances, levels)
        path = path + steps
        variances = np.diagonal(covariances, 0, 1, 2)[:, :MOTION]
        if not np.all(np.isfinite(path)) or np.min(variances) <= 0:
            return None
        settled = np.max(np.abs(steps[:, :MOTION]) / np.sqrt(variances))
        if number > max(TUNED) and settled < CONVERGED:
            return _told(flight, path, first, levels)
    return None


def usual_levels(flight: AidedFlight) -> Levels:
    """Noise of the inputs as it is seen beside their motion, the rest as usual."""
    seen = [noise_level(column) for column in flight.inputs.T]
    rates, forces = (max(float(np.median(seen[3 * k : 3 * k + 3])), LEAST_NOISE[k]) for k in range(2))
    return Levels(rates, forces, *WALKS, FIX_NOISE)


def ned_from_frd(angles: Array) -> Array:
    """Rotations (N, 3, 3) of phi, theta and psi (N, 3) in rad."""
    return np.asarray(Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix(), dtype=np.float64)


def _first_path(flight: AidedFlight) -> Array:
    """Errors of nothing, velocities of the fixes in axes of the attitude that was told."""
    path = np.zeros((len(flight.at), UNKNOWNS))
    path[:, 3:MOTION] = flight.attitude[flight.at]
    path[:, :3] = np.einsum("nji,nj->ni", ned_from_frd(path[:, 3:MOTION]), flight.velocity)
    return path


def _fixes_told(path: Array, rates: Array, arm: tuple[float, float, float]) -> Array:
    """Velocities (K, 3) that faultless fixes would tell."""
    velocity = path[:, :3] - np.cross(rates - path[:, OFFSETS : OFFSETS + 3], np.asarray(arm))
    told: Array = np.einsum("nij,nj->ni", ned_from_frd(path[:, 3:MOTION]), velocity)
    return told


def _matrix(row: Array) -> Array:
    """Both matrices as one (6, 6)."""
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = row[MATRICES:LAG].reshape(2, 3, 3)
    return both


def _linear(flight: AidedFlight, path: Array) -> _Linear:
    dense = with_middles(flight.inputs)
    slopes = np.gradient(dense, flight.step / 2, axis=0)
    slopes[:, :3] = 0.0  # the rates are what the forces are late behind
    parts = [_interval(flight, path, index, dense, slopes) for index in range(len(flight.at) - 1)]
    over, spread, ends, means = (np.array([part[place] for part in parts]) for place in range(4))
    seconds = np.diff(flight.at) * flight.step
    shifts = path[:-1] - path[1:]
    shifts[:, :MOTION] = ends - path[1:, :MOTION]
    sums = np.zeros((len(parts), 6, UNKNOWNS))
    sums[:, :, OFFSETS:MATRICES] = seconds[:, None, None] * np.eye(6)
    for a in range(6):
        kind = 3 * (a // 3)
        sums[:, a, MATRICES + 3 * a : MATRICES + 3 * a + 3] = seconds[:, None] * means[:, kind : kind + 3]
    grown = np.einsum("nap,np->na", sums, path[:-1])
    rates = flight.inputs[flight.at, :3]
    left = flight.velocity - _fixes_told(path, rates, flight.arm)
    return _Linear(over, shifts, spread, seconds, sums, grown, _fix_slopes(path, rates, flight.arm), left)


def _interval(
    flight: AidedFlight, path: Array, index: int, dense: Array, slopes: Array
) -> tuple[Array, Array, Array, Array]:
    """From one fix to the next: `over_interval`, the motion at its end (6,) and the mean inputs (6,)."""
    inside = slice(2 * int(flight.at[index]), 2 * int(flight.at[index + 1]) + 1)
    row, raw, rising = path[index], dense[inside], slopes[inside]
    inputs = raw - row[OFFSETS:MATRICES] - raw @ _matrix(row).T + row[LAG] * rising
    states = flown(np.append(row[:MOTION], np.zeros(3)), inputs, flight.step, STANDARD_GRAVITY)
    steps = linearised(states, inputs, flight.step, STANDARD_GRAVITY)
    over, spread = over_interval(*steps, raw, rising)
    return over, spread, states[-1, :MOTION], np.mean(raw[1::2], axis=0)


def _fix_slopes(path: Array, rates: Array, arm: tuple[float, float, float]) -> Array:
    """Slopes (K, 3, 31) of what the fixes tell, by central differences."""
    slopes = np.zeros((len(path), 3, UNKNOWNS))
    for column in range(OFFSETS + 3):
        shift = np.zeros(UNKNOWNS)
        shift[column] = SHIFT
        ahead, behind = (_fixes_told(path + side * shift, rates, arm) for side in (1, -1))
        slopes[:, :, column] = (ahead - behind) / (2 * SHIFT)
    return slopes


def _added(linear: _Linear, levels: Levels) -> Array:
    """What an interval adds to the covariance (K - 1, 31, 31)."""
    added = np.zeros((len(linear.over), UNKNOWNS, UNKNOWNS))
    added[:, :MOTION, :MOTION] = levels.rates**2 * linear.spread[:, 0] + levels.forces**2 * linear.spread[:, 1]
    walks = np.repeat((levels.rate_walk**2, levels.force_walk**2), 3)
    places = np.arange(OFFSETS, MATRICES)
    added[:, places, places] = linear.seconds[:, None] * walks
    return added


def _likeliest(linear: _Linear, first: Array, levels: Levels, usual: Levels) -> Levels:
    """The levels at the largest likelihood, held to the usual ones by what is known of such sensors."""
    about, least = np.log(usual), np.log((*LEAST_NOISE, 0.1 * WALKS[0], 0.1 * WALKS[1], LEAST_FIX_NOISE))

    def cost(logs: Array) -> float:
        means, covariance, nothing = first.copy(), np.diag(FIRST**2), (np.zeros((0, 0)), np.zeros((0, 0, 0)))
        found = Levels(*np.exp(np.maximum(logs, least)))
        likelihood = filtered(_chain(linear, found), means, covariance, *nothing)
        return float(0.5 * np.sum(((logs - about) / FACTORS) ** 2) - likelihood)

    options = {"maxfev": 300, "xatol": 0.05, "fatol": 0.05}
    found = minimize(cost, np.log(levels), method="Nelder-Mead", options=options).x
    return Levels(*np.exp(np.maximum(found, least)).tolist())


def _chain(linear: _Linear, levels: Levels) -> Chain:
    return Chain(
        linear.over, linear.shifts, _added(linear, levels), linear.sums, linear.grown, linear.slopes, linear.left,
        levels.fixes,
    )  # fmt: skip


def _forward(linear: _Linear, first: Array, levels: Levels) -> tuple[Array, Array]:
    """Deviations (K, 31) from the path behind each fix, and their covariances."""
    count = len(linear.left)
    means, covariances = np.zeros((count, UNKNOWNS)), np.zeros((count, UNKNOWNS, UNKNOWNS))
    filtered(_chain(linear, levels), first.copy(), np.diag(FIRST**2), means, covariances)
    return means, covariances


def _backward(linear: _Linear, means: Array, covariances: Array, levels: Levels) -> Array:
    """Smoothed deviations (K, 31) from the path."""
    smooth, added = means.copy(), _added(linear, levels)
    step = np.eye(UNKNOWNS)
    for k in range(len(means) - 2, -1, -1):
        step[:MOTION] = linear.over[k]
        across = step @ covariances[k]
        ahead = across @ step.T + added[k]
        gain = np.linalg.solve(ahead / np.outer(FIRST, FIRST), across / FIRST[:, None]).T / FIRST
        smooth[k] += gain @ (smooth[k + 1] - step @ means[k] - linear.shifts[k])
    return smooth


def _told(flight: AidedFlight, path: Array, first: Array, levels: Levels) -> AidedFit:
    """The errors' means over the stretch, with the covariance that the filter has of them at its end."""
    linear = _linear(flight, path)
    mean = np.append(first - path[0], np.zeros(6))
    covariance = np.zeros((len(mean), len(mean)))
    covariance[:UNKNOWNS, :UNKNOWNS] = np.diag(FIRST**2)
    filtered(_chain(linear, levels), mean, covariance, np.zeros((0, 0)), np.zeros((0, 0, 0)))
    whole = float(np.sum(linear.seconds))
    told = _fixes_told(path, flight.inputs[flight.at, :3], flight.arm)
    return AidedFit(
        mean[UNKNOWNS:] / whole, covariance[UNKNOWNS:, UNKNOWNS:] / whole**2, path[:, :MOTION], told, levels
    )
