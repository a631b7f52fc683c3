"""Errors of an IMU from the ground velocities of a GPS receiver, without a measured attitude.

The attitude in a log is a filter's estimate from the same gyros, with errors slower than a record. Here rates and
specific forces propagate velocity and attitude from fix to fix (`models.rigid_body`); an error of a rate tilts
gravity, so the velocity error grows with the square of time. Noise of the IMU, random walks of its biases and noise
of the fixes maximize the likelihood; scales, misalignments and a lag of the accelerometers have priors.

Extended Kalman filter and Rauch-Tung-Striebel smoother, iterated about the smoothed path (Bell, The Iterated Kalman
Smoother as a Gauss-Newton Method, SIAM J. Optimization 4(3), 1994); error model as in Groves, Principles of GNSS,
Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., chapter 14.

Unknowns, 31: u, v, w (m/s; over ground), phi, theta, psi (rad) at the IMU's position; biases of the six inputs
(rad/s, m/s^2); two 3 x 3 matrices (-) of scales and misalignments, of rates and of forces, row by row; lag of the
forces behind the rates (s). The filter may have six more: the inputs' errors integrated over time.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from logs.identification.data.noise_level import noise_level
from logs.identification.estimators.flight_path import EQUATIONS, LARGE_ERRORS, SENSORS
from logs.identification.estimators.registry import ESTIMATORS, Estimator, Request
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.rigid_body import INPUTS, UNITS, integrate, linearize, with_middles
from logs.identification.results import Array, EstimationResult, FitSeries, estimate
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

METHOD = "gps_aided"
ATTITUDE, VELOCITIES = ("phi", "theta", "psi"), ("v_north", "v_east", "v_down")
MOTION, OFFSETS, MATRICES, LAG = 6, 6, 12, 30
"""-; number of motion states, and first index of the others"""
UNKNOWNS = 31
PRIOR_DEVIATIONS = np.array(
    [3.0] * 3 + [0.2] * 2 + [0.5] + [0.2] * 3 + [1.0] * 3 + [0.01] * 9 + [0.007] * 9 + [0.003]
)
"""SI; standard deviations before the first fix. Motion: of the initial guess;
scales and misalignments: 1 % and 0.6 deg of gyros, 0.7 % and 0.4 deg of accelerometers (`AhrsGains.level_error`);
half a sample of lag either way"""
TYPICAL_WALKS = (3e-4, 1e-3)
"""rad/s^1.5, m/s^2.5; random walks of the biases: warming, and errors of scale in and out of turns"""
FIX_NOISE = 0.1
"""m/s; of a receiver's velocity"""
MIN_NOISE = (1e-4, 1e-3)
"""rad/s, m/s^2; of a sample, at least"""
MIN_FIX_NOISE = 0.01
"""m/s; resolution of a receiver's velocity"""
LEVEL_DEVIATIONS = np.array([1.0, 1.0, 1.0, 1.0, 5.0])
"""-; standard deviation of the levels' logarithms about the typical ones"""
ITERATIONS, LEVEL_ITERATIONS = 12, (1, 3)
"""-; iterations at most, and those before which the noise levels are estimated"""
CONVERGED = 0.1
"""-; largest step of the motion, in standard errors"""
SHIFT = 1e-5
"""SI; half width of central differences"""


class AidedFlight(NamedTuple):
    """A segment of flight measured by an IMU and a GPS receiver."""

    time: Array
    """s; (N,), even"""
    inputs: Array
    """rad/s, m/s^2; (N, 6), in the order of `rigid_body.INPUTS`"""
    attitude: Array
    """rad; (N, 3), phi, theta, psi; initial guess only"""
    at: NDArray[np.int64]
    """-; (K,), sample of each fix, increasing"""
    velocity: Array
    """m/s; (K, 3), NED over ground"""
    arm: tuple[float, float, float]
    """m; from the receiver's antenna, or the center of mass, to the IMU, FRD"""

    @property
    def step(self) -> float:
        """s; between samples."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)


class NoiseLevels(NamedTuple):
    """Noise levels."""

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
    """Errors of the IMU and its motion."""

    errors: Array
    """rad/s, m/s^2; (6,), mean over the segment of measured minus true, scales and misalignments included"""
    covariance: Array
    """(6, 6); of these"""
    motion: Array
    """m/s, rad; (K, 6), u, v, w over ground and phi, theta, psi at the fixes"""
    predicted: Array
    """m/s; (K, 3), fixes that the smoothed path predicts"""
    levels: NoiseLevels


class _Intervals(NamedTuple):
    """Motion linearized about a path, from fix to fix."""

    transition: Array
    """(K, 6, 31); motion at an interval's end by the unknowns at its start"""
    shifts: Array
    """(K, 31); added to the means"""
    process_noise: Array
    """(K, 31, 31); of the noise levels, empty before they are known"""
    sums: Array
    """(K, 6, 31); growth of the six integrals by the unknowns"""
    integrals: Array
    """(K, 6); added to the sums"""
    slopes: Array
    """(K + 1, 3, 31); Jacobian of the fixes"""
    innovations: Array
    """m/s; (K + 1, 3), measured minus predicted fixes"""
    spread: Array
    """(K, 2, 6, 6); covariance by unit noise of rates and of forces"""
    seconds: Array
    """s; (K,)"""


def aided_fit(flight: AidedFlight) -> AidedFit | None:
    """The smoothed path and the mean errors of the inputs; None if the iterations do not converge."""
    path = _initial_path(flight)
    first, levels = path[0].copy(), typical_levels(flight)
    for number in range(ITERATIONS):
        linear = _linear(flight, path)
        if number in LEVEL_ITERATIONS:
            levels = _maximum_likelihood(linear, first - path[0], levels, typical_levels(flight))
        means, covariances = _forward(linear, first - path[0], levels)
        steps = _backward(linear, means, covariances, levels)
        path = path + steps
        variances = np.diagonal(covariances, 0, 1, 2)[:, :MOTION]
        if not np.all(np.isfinite(path)) or np.min(variances) <= 0:
            return None
        step_size = np.max(np.abs(steps[:, :MOTION]) / np.sqrt(variances))
        if number > max(LEVEL_ITERATIONS) and step_size < CONVERGED:
            return _mean_errors(flight, path, first, levels)
    return None


def typical_levels(flight: AidedFlight) -> NoiseLevels:
    """Noise of the inputs by their differences between samples; typical values of the others."""
    noise = [noise_level(column) for column in flight.inputs.T]
    rates, forces = (max(float(np.median(noise[3 * k : 3 * k + 3])), MIN_NOISE[k]) for k in range(2))
    return NoiseLevels(rates, forces, *TYPICAL_WALKS, FIX_NOISE)


def ned_from_frd(angles: Array) -> Array:
    """Rotations (N, 3, 3) of phi, theta and psi (N, 3) in rad."""
    return np.asarray(Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix(), dtype=np.float64)


def _initial_path(flight: AidedFlight) -> Array:
    """No errors, velocities of the fixes in the axes of the measured attitude."""
    path = np.zeros((len(flight.at), UNKNOWNS))
    path[:, 3:MOTION] = flight.attitude[flight.at]
    path[:, :3] = np.einsum("nji,nj->ni", ned_from_frd(path[:, 3:MOTION]), flight.velocity)
    return path


def _predicted_fixes(path: Array, rates: Array, arm: tuple[float, float, float]) -> Array:
    """Velocities (K, 3) that the path predicts for the fixes."""
    velocity = path[:, :3] - np.cross(rates - path[:, OFFSETS : OFFSETS + 3], np.asarray(arm))
    predicted: Array = np.einsum("nij,nj->ni", ned_from_frd(path[:, 3:MOTION]), velocity)
    return predicted


def _matrix(row: Array) -> Array:
    """Both matrices as one (6, 6)."""
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = row[MATRICES:LAG].reshape(2, 3, 3)
    return both


def _linear(flight: AidedFlight, path: Array) -> _Intervals:
    dense = with_middles(flight.inputs)
    slopes = np.gradient(dense, flight.step / 2, axis=0)
    slopes[:, :3] = 0.0  # the lag is that of the forces behind the rates
    parts = [_interval(flight, path, index, dense, slopes) for index in range(len(flight.at) - 1)]
    transition, spread, ends, means = (np.array([part[place] for part in parts]) for place in range(4))
    seconds = np.diff(flight.at) * flight.step
    shifts = path[:-1] - path[1:]
    shifts[:, :MOTION] = ends - path[1:, :MOTION]
    sums = np.zeros((len(parts), 6, UNKNOWNS))
    sums[:, :, OFFSETS:MATRICES] = seconds[:, None, None] * np.eye(6)
    for a in range(6):
        kind = 3 * (a // 3)
        sums[:, a, MATRICES + 3 * a : MATRICES + 3 * a + 3] = seconds[:, None] * means[:, kind : kind + 3]
    integrals = np.einsum("nap,np->na", sums, path[:-1])
    rates = flight.inputs[flight.at, :3]
    innovations = flight.velocity - _predicted_fixes(path, rates, flight.arm)
    jacobian, nothing = _fix_slopes(path, rates, flight.arm), np.zeros((0, 0, 0))
    return _Intervals(transition, shifts, nothing, sums, integrals, jacobian, innovations, spread, seconds)


def _interval(
    flight: AidedFlight, path: Array, index: int, dense: Array, slopes: Array
) -> tuple[Array, Array, Array, Array]:
    """From one fix to the next: `_interval_transition`, the motion at its end (6,) and the mean inputs (6,)."""
    inside = slice(2 * int(flight.at[index]), 2 * int(flight.at[index + 1]) + 1)
    row, raw, rising = path[index], dense[inside], slopes[inside]
    inputs = raw - row[OFFSETS:MATRICES] - raw @ _matrix(row).T + row[LAG] * rising
    states = integrate(np.append(row[:MOTION], np.zeros(3)), inputs, flight.step, STANDARD_GRAVITY)
    steps = linearize(states, inputs, flight.step, STANDARD_GRAVITY)
    transition, spread = _interval_transition(*steps, raw, rising)
    return transition, spread, states[-1, :MOTION], np.mean(raw[1::2], axis=0)


def _fix_slopes(path: Array, rates: Array, arm: tuple[float, float, float]) -> Array:
    """Jacobian (K, 3, 31) of the predicted fixes, by central differences."""
    slopes = np.zeros((len(path), 3, UNKNOWNS))
    for column in range(OFFSETS + 3):
        shift = np.zeros(UNKNOWNS)
        shift[column] = SHIFT
        ahead, behind = (_predicted_fixes(path + side * shift, rates, arm) for side in (1, -1))
        slopes[:, :, column] = (ahead - behind) / (2 * SHIFT)
    return slopes


def _with_noise(linear: _Intervals, levels: NoiseLevels) -> _Intervals:
    """The intervals with the process noise of the noise levels."""
    process_noise = np.zeros((len(linear.transition), UNKNOWNS, UNKNOWNS))
    of_rates, of_forces = np.swapaxes(linear.spread, 0, 1)
    process_noise[:, :MOTION, :MOTION] = levels.rates**2 * of_rates + levels.forces**2 * of_forces
    walks = np.repeat((levels.rate_walk**2, levels.force_walk**2), 3)
    places = np.arange(OFFSETS, MATRICES)
    process_noise[:, places, places] = linear.seconds[:, None] * walks
    return linear._replace(process_noise=process_noise)


def _maximum_likelihood(linear: _Intervals, first: Array, levels: NoiseLevels, typical: NoiseLevels) -> NoiseLevels:
    """The noise levels of the largest posterior likelihood, with priors about the typical ones."""
    about, least = (
        np.log(typical),
        np.log((*MIN_NOISE, 0.1 * TYPICAL_WALKS[0], 0.1 * TYPICAL_WALKS[1], MIN_FIX_NOISE)),
    )

    def cost(logs: Array) -> float:
        means, covariance, nothing = (
            first.copy(),
            np.diag(PRIOR_DEVIATIONS**2),
            (np.zeros((0, 0)), np.zeros((0, 0, 0))),
        )
        found = NoiseLevels(*np.exp(np.maximum(logs, least)))
        likelihood = _kalman_filter(_with_noise(linear, found), found.fixes, means, covariance, *nothing)
        return float(0.5 * np.sum(((logs - about) / LEVEL_DEVIATIONS) ** 2) - likelihood)

    options = {"maxfev": 300, "xatol": 0.05, "fatol": 0.05}
    found = minimize(cost, np.log(levels), method="Nelder-Mead", options=options).x
    return NoiseLevels(*np.exp(np.maximum(found, least)).tolist())


def _forward(linear: _Intervals, first: Array, levels: NoiseLevels) -> tuple[Array, Array]:
    """Deviations (K, 31) from the path after each fix, and their covariances."""
    count = len(linear.innovations)
    means, covariances = np.zeros((count, UNKNOWNS)), np.zeros((count, UNKNOWNS, UNKNOWNS))
    prior = np.diag(PRIOR_DEVIATIONS**2)
    _kalman_filter(_with_noise(linear, levels), levels.fixes, first.copy(), prior, means, covariances)
    return means, covariances


def _backward(linear: _Intervals, means: Array, covariances: Array, levels: NoiseLevels) -> Array:
    """Smoothed deviations (K, 31) from the path."""
    smooth, process_noise = means.copy(), _with_noise(linear, levels).process_noise
    step = np.eye(UNKNOWNS)
    for k in range(len(means) - 2, -1, -1):
        step[:MOTION] = linear.transition[k]
        across = step @ covariances[k]
        ahead = across @ step.T + process_noise[k]
        gain = (
            np.linalg.solve(
                ahead / np.outer(PRIOR_DEVIATIONS, PRIOR_DEVIATIONS), across / PRIOR_DEVIATIONS[:, None]
            ).T
            / PRIOR_DEVIATIONS
        )
        smooth[k] += gain @ (smooth[k + 1] - step @ means[k] - linear.shifts[k])
    return smooth


def _mean_errors(flight: AidedFlight, path: Array, first: Array, levels: NoiseLevels) -> AidedFit:
    """The errors' means over the segment, by their integrals at its end."""
    linear = _linear(flight, path)
    mean = np.append(first - path[0], np.zeros(6))
    covariance = np.zeros((len(mean), len(mean)))
    covariance[:UNKNOWNS, :UNKNOWNS] = np.diag(PRIOR_DEVIATIONS**2)
    nothing = np.zeros((0, 0)), np.zeros((0, 0, 0))
    _kalman_filter(_with_noise(linear, levels), levels.fixes, mean, covariance, *nothing)
    whole = float(np.sum(linear.seconds))
    predicted = _predicted_fixes(path, flight.inputs[flight.at, :3], flight.arm)
    return AidedFit(
        mean[UNKNOWNS:] / whole, covariance[UNKNOWNS:, UNKNOWNS:] / whole**2, path[:, :MOTION], predicted, levels
    )


# --- result -------------------------------------------------------------------------------------------------


def aided_result(flight: AidedFlight, fit: AidedFit) -> EstimationResult:
    """Biases of the IMU, and the fixes beside the path's prediction."""
    deviations = np.sqrt(np.diag(fit.covariance))
    rows = zip(INPUTS, fit.errors, deviations, strict=True)
    found = tuple(estimate(f"bias_{name}", UNITS[name], float(value), float(error)) for name, value, error in rows)
    imprecise = tuple(
        Finding("imprecise", "warning", one.name, one.standard_error, LARGE_ERRORS[one.unit], {"unit": one.unit})
        for one in found if one.standard_error > LARGE_ERRORS[one.unit]
    )  # fmt: skip
    notes = (Finding("measured_by_gps", "info"), Finding("mean_bias", "info"))
    series = tuple(_fix_series(flight, fit, column) for column in range(3))
    return EstimationResult(
        METHOD, "path", "rigid body", (*EQUATIONS, SENSORS), estimates=found, covariance=fit.covariance,
        series=series, samples=len(flight.at), findings=(*notes, *imprecise),
    )  # fmt: skip


def _fix_series(flight: AidedFlight, fit: AidedFit, column: int) -> FitSeries:
    """Measured and predicted velocity on an even time base."""
    time = flight.time[flight.at]
    even = time[0] + float(np.median(np.diff(time))) * np.arange(len(time))
    if np.max(np.abs(even - time)) > flight.step:  # fixes are missing
        even = np.linspace(time[0], time[-1], len(time))
    values = (np.interp(even, time, one[:, column]) for one in (flight.velocity, fit.predicted))
    return FitSeries("flight", VELOCITIES[column], "m/s", even, *values)


def estimate_gps_aided(request: Request) -> EstimationResult:
    """Row of the registry: the first experiment, velocities NaN between fixes; option ``arm`` as in `AidedFlight`.

    Raises:
        InputError: a signal is missing.
    """
    one = request.experiments[0]
    missing = [name for name in (*INPUTS, *ATTITUDE, *VELOCITIES) if name not in one.signals]
    if missing:
        raise InputError(f"{one.name}: {', '.join(missing)} not measured")
    inputs, attitude, velocity = (np.column_stack([one.signals[name] for name in names])
                                  for names in (INPUTS, ATTITUDE, VELOCITIES))  # fmt: skip
    at = np.flatnonzero(np.all(np.isfinite(velocity), axis=1))
    flight = AidedFlight(one.time, inputs, attitude, at, velocity[at], request.options.get("arm", (0.0, 0.0, 0.0)))
    fit = aided_fit(flight)
    if fit is None:
        failed = Finding(
            "not_converged", "withheld", METHOD, details={"reason": "the smoothed path does not converge"}
        )
        return EstimationResult(METHOD, "path", status="not converged", findings=(failed,))
    return aided_result(flight, fit)


ESTIMATORS[METHOD] = Estimator(
    METHOD, "IMU errors by GPS velocities (iterated Kalman smoother)", "Groves 2013, ch. 14; Bell 1994",
    estimate_gps_aided,
)  # fmt: skip
register({
    "measured_by_gps": Entry(
        "by north, east and down velocities of the GPS; the recorded attitude is the initial guess only",
        "Which measurements the errors of the IMU come from.",
    ),
    "mean_bias": Entry(
        "bias: mean over the record of measured minus true, scale and misalignment included",
        "What a bias by GPS velocities contains.",
    ),
})  # fmt: skip


# --- compiled ------------------------------------------------------------------------------------------------


@njit(cache=True)
def _interval_transition(carry: Array, gain: Array, inputs: Array, slopes: Array) -> tuple[Array, Array]:
    """Motion at an interval's end by the unknowns at its start (6, 31), and covariance by unit noise (2, 6, 6).

    ``carry`` (N, 9, 9) and ``gain`` (N, 9, 6) are the steps' Jacobians, ``inputs`` and ``slopes`` (2 N + 1, 6) the
    measured inputs and the rates that a lag multiplies. The unit noise is that of rates and of forces.
    """
    transition, spread = np.zeros((MOTION, UNKNOWNS)), np.zeros((2, MOTION, MOTION))
    for i in range(MOTION):
        transition[i, i] = 1.0
    for k in range(carry.shape[0]):
        step, noise = np.ascontiguousarray(carry[k, :MOTION, :MOTION]), np.ascontiguousarray(gain[k, :MOTION])
        transition = step @ transition
        for i in range(MOTION):
            for a in range(6):
                transition[i, OFFSETS + a] -= noise[i, a]
                transition[i, LAG] += noise[i, a] * slopes[2 * k + 1, a]
                for b in range(3):
                    transition[i, MATRICES + 3 * a + b] -= noise[i, a] * inputs[2 * k + 1, 3 * (a // 3) + b]
        for kind in range(2):
            part = np.ascontiguousarray(noise[:, 3 * kind : 3 * kind + 3])
            spread[kind] = step @ spread[kind] @ step.T + part @ part.T
    return transition, spread


@njit(cache=True)
def _propagate_covariance(covariance: Array, transition: Array, sums: Array, process_noise: Array) -> None:
    """Propagate the ``covariance`` (n, n) by an interval, in place.

    The motion follows ``transition`` (6, 31); the integrals, if there are any, grow by ``sums`` (6, 31).
    """
    rows = transition @ covariance[:UNKNOWNS]
    near = np.ascontiguousarray(rows[:, :UNKNOWNS])
    if covariance.shape[0] > UNKNOWNS:
        more = sums @ covariance[:UNKNOWNS] + covariance[UNKNOWNS:]
        corner = np.ascontiguousarray(more[:, :UNKNOWNS]) @ sums.T + more[:, UNKNOWNS:]
        across = near @ sums.T + rows[:, UNKNOWNS:]
        covariance[UNKNOWNS:], covariance[:, UNKNOWNS:] = more, more.T
        covariance[UNKNOWNS:, UNKNOWNS:] = corner
        covariance[:MOTION, UNKNOWNS:], covariance[UNKNOWNS:, :MOTION] = across, across.T
    block = near @ transition.T
    covariance[:MOTION, MOTION:UNKNOWNS] = rows[:, MOTION:UNKNOWNS]
    covariance[MOTION:UNKNOWNS, :MOTION] = rows[:, MOTION:UNKNOWNS].T
    covariance[:MOTION, :MOTION] = block
    covariance[:UNKNOWNS, :UNKNOWNS] += process_noise


@njit(cache=True)
def _kalman_filter(
    intervals: _Intervals, noise: float, mean: Array, covariance: Array, means: Array, covariances: Array
) -> float:
    """Kalman filter over K intervals between K + 1 fixes; the logarithm of the likelihood, up to a constant.

    ``noise`` (m/s) is that of a fix. ``mean`` (n,) and ``covariance`` (n, n) are those before the first fix, and
    become those after the last; ``means`` (K + 1, 31) and ``covariances`` (K + 1, 31, 31), unless empty, receive
    those after each.
    """
    transition, shifts, process_noise, sums, integrals, slopes, innovations, _, _ = intervals
    likelihood, size = 0.0, mean.shape[0]
    for k in range(innovations.shape[0]):
        if k > 0:
            if size > UNKNOWNS:
                mean[UNKNOWNS:] += sums[k - 1] @ mean[:UNKNOWNS] + integrals[k - 1]
            mean[:MOTION] = transition[k - 1] @ mean[:UNKNOWNS]
            mean[:UNKNOWNS] += shifts[k - 1]
            _propagate_covariance(covariance, transition[k - 1], sums[k - 1], process_noise[k - 1])
        for row in range(3):
            gain_numerator = slopes[k, row] @ covariance[:UNKNOWNS]  # symmetric
            variance = slopes[k, row] @ gain_numerator[:UNKNOWNS] + noise**2
            innovation = innovations[k, row] - slopes[k, row] @ mean[:UNKNOWNS]
            mean += gain_numerator * (innovation / variance)
            covariance -= np.outer(gain_numerator, gain_numerator / variance)
            likelihood -= 0.5 * (np.log(variance) + innovation**2 / variance)
        if means.shape[0] > 0:
            means[k], covariances[k] = mean[:UNKNOWNS], covariance[:UNKNOWNS, :UNKNOWNS]
    return likelihood
