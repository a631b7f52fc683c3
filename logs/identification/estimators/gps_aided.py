"""Errors of an IMU from the ground velocities of a GPS receiver, without a measured attitude.

The attitude in a log is a filter's estimate from the same gyros, with errors slower than a record. Here rates and
specific forces propagate velocity and attitude from fix to fix (`models.rigid_body`); an error of a rate tilts
gravity, so the velocity error grows with the square of time. The path of largest posterior probability is found by
Gauss-Newton steps (Bell, The Iterated Kalman Smoother as a Gauss-Newton Method, SIAM J. Optimization 4(3), 1994).
Their normal equations are banded, since a fix is joined to the next one only. Noise of the IMU, random walks of its
biases and noise of the fixes maximize the likelihood; scales and misalignments have priors (Groves, Principles of
GNSS, Inertial, and Multisensor Integrated Navigation Systems, 2nd ed., ch. 14).

States: u, v, w (m/s, over ground), phi, theta, psi (rad) at the IMU's position; the biases of the six inputs (rad/s,
m/s^2); two 3 x 3 matrices (-) of scales and misalignments, of rates and of forces, row by row, which are constant.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from logs.identification.data.signal_errors import noise_level
from logs.identification.estimators.flight_path import EQUATIONS, LARGE_ERRORS, SENSORS
from logs.identification.estimators.registry import Request
from logs.identification.findings import Entry, Finding, register
from logs.identification.models.rigid_body import INPUTS, UNITS, integrate, linearize, with_middles
from logs.identification.results import Array, EstimationResult, FitSeries, estimates
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

METHOD = "gps_aided"
ATTITUDE, VELOCITIES = ("phi", "theta", "psi"), ("v_north", "v_east", "v_down")
MOTION, MATRICES, STATES = 6, 12, 30
"""-; number of motion states, first index of the matrices, number of states"""
PRIOR_DEVIATIONS = np.array([3.0] * 3 + [0.2] * 2 + [0.5] + [0.2] * 3 + [1.0] * 3 + [0.01] * 9 + [0.007] * 9)
"""SI; standard deviations before the first fix; of the motion those of the initial guess, of scales and misalignments
1 % and 0.6 deg of gyros, 0.7 % and 0.4 deg of accelerometers"""
TYPICAL_WALKS = (3e-4, 1e-3)
"""rad/s^1.5, m/s^2.5; random walks of the biases"""
FIX_NOISE, MIN_FIX_NOISE = 0.1, 0.01
"""m/s; noise of a receiver's velocity; its resolution"""
MIN_NOISE = (1e-4, 1e-3)
"""rad/s, m/s^2; of a sample, at least"""
LEVEL_DEVIATIONS = np.array([1.0, 1.0, 1.0, 1.0, 5.0])
"""-; standard deviation of the levels' logarithms about the typical ones"""
ITERATIONS, LEVEL_ITERATIONS = 12, (1, 3)
"""-; iterations at most, and those before which the noise levels are estimated"""
CONVERGED = 0.1
"""-; length of the last step in standard errors, which bounds that of every state"""
SHIFT = 1e-5
"""SI; half width of central differences"""

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
    """rad/s^1.5; of the rates' biases"""
    force_walk: float
    """m/s^2.5; of the forces' biases"""
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


class _Linearized(NamedTuple):
    """Motion and fixes linearized about a path, n states."""

    transition: Array
    """(K - 1, 12, n); motion and biases at a fix by the states at the one before"""
    integrals: Array
    """(K - 1, 6, n); integrated errors by the states"""
    shifts: Array
    """(K - 1, 12); added to the deviations from the path"""
    unit_noise: Array
    """(4, K - 1, 12, 12); process noise by unit levels of rates, forces and their walks"""
    slopes: Array
    """(K, 3, 12); Jacobian of the fixes"""
    innovations: Array
    """m/s; (K, 3), measured minus predicted fixes"""


class _Step(NamedTuple):
    """Solution of the normal equations of one linearization."""

    states: Array
    """(K, n); deviations from the path"""
    length: float
    """-; of these, in standard errors (Newton decrement)"""
    likelihood: float
    """-; logarithm of the marginal likelihood of the noise levels, up to a constant"""
    covariance: Array
    """(6, 6); of the integrated errors"""


def aided_fit(flight: AidedFlight) -> AidedFit | None:
    """The smoothed path and the mean errors of the inputs; None if the iterations do not converge."""
    path = np.zeros((len(flight.at), STATES))
    path[:, 3:MOTION] = flight.attitude[flight.at]
    path[:, :3] = np.einsum("nji,nj->ni", ned_from_frd(path[:, 3:MOTION]), flight.velocity)
    first, levels = path[0].copy(), typical_levels(flight)
    for number in range(ITERATIONS):
        linear = _linearized(flight, path)
        if number in LEVEL_ITERATIONS:
            levels = _maximum_likelihood(linear, first - path[0], levels, typical_levels(flight))
        try:
            step = _solved(linear, levels, first - path[0])
        except np.linalg.LinAlgError:
            return None
        if number > max(LEVEL_ITERATIONS) and step.length < CONVERGED:
            break
        path = path + step.states
    else:
        return None
    path = path + step.states
    total = float(flight.at[-1] - flight.at[0]) * flight.step
    errors = np.einsum("kan,kn->a", linear.integrals, path[:-1]) / total
    predicted = _predicted_fixes(flight, path)
    return AidedFit(errors, step.covariance / total**2, path[:, :MOTION], predicted, levels)


def typical_levels(flight: AidedFlight) -> NoiseLevels:
    """Noise of the inputs by their differences between samples; typical values of the others."""
    noise = [noise_level(column) for column in flight.inputs.T]
    rates, forces = (max(float(np.median(noise[3 * k : 3 * k + 3])), MIN_NOISE[k]) for k in range(2))
    return NoiseLevels(rates, forces, *TYPICAL_WALKS, FIX_NOISE)


def ned_from_frd(angles: Array) -> Array:
    """Rotations (N, 3, 3) of phi, theta and psi (N, 3) in rad."""
    return np.asarray(Rotation.from_euler("ZYX", angles[:, ::-1]).as_matrix(), dtype=np.float64)


def _predicted_fixes(flight: AidedFlight, path: Array) -> Array:
    """Velocities (K, 3) that the path predicts for the fixes."""
    rates = flight.inputs[flight.at, :3] - path[:, MOTION : MOTION + 3]
    velocity = path[:, :3] - np.cross(rates, np.asarray(flight.arm))
    predicted: Array = np.einsum("nij,nj->ni", ned_from_frd(path[:, 3:MOTION]), velocity)
    return predicted


def _linearized(flight: AidedFlight, path: Array) -> _Linearized:
    dense, count = with_middles(flight.inputs), len(path) - 1
    seconds = np.diff(flight.at) * flight.step
    transition, integrals = np.zeros((count, MATRICES, STATES)), np.zeros((count, 6, STATES))
    transition[:, MOTION:, MOTION:MATRICES] = np.eye(MATRICES - MOTION)
    unit_noise, shifts = np.zeros((4, count, MATRICES, MATRICES)), (path[:-1] - path[1:])[:, :MATRICES]
    for k in range(count):
        inside = slice(2 * int(flight.at[k]), 2 * int(flight.at[k + 1]) + 1)
        inputs = dense[inside] - path[k, MOTION:MATRICES] - dense[inside] @ _matrix(path[k]).T
        integrals[k] = seconds[k] * _errors_by_states(dense[inside][1::2].mean(axis=0))
        states = integrate(np.append(path[k, :MOTION], np.zeros(3)), inputs, flight.step, STANDARD_GRAVITY)
        steps = linearize(states, inputs, flight.step, STANDARD_GRAVITY)
        _accumulate(*steps, dense[inside], transition[k, :MOTION], unit_noise[:2, k])
        shifts[k, :MOTION] = states[-1, :MOTION] - path[k + 1, :MOTION]
    for kind in range(2):
        places = MOTION + 3 * kind + np.arange(3)
        unit_noise[2 + kind][:, places, places] = seconds[:, None]
    slopes = np.zeros((count + 1, 3, MATRICES))
    for column in range(MOTION + 3):
        shift = np.zeros(STATES)
        shift[column] = SHIFT
        ahead, behind = (_predicted_fixes(flight, path + side * shift) for side in (1, -1))
        slopes[:, :, column] = (ahead - behind) / (2 * SHIFT)
    innovations = flight.velocity - _predicted_fixes(flight, path)
    return _Linearized(transition, integrals, shifts, unit_noise, slopes, innovations)


def _matrix(state: Array) -> Array:
    """Both matrices of scales and misalignments as one (6, 6)."""
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = state[MATRICES:].reshape(2, 3, 3)
    return both


def _errors_by_states(inputs: Array) -> Array:
    """Derivatives (6, n) of the errors of the ``inputs`` (6,) by the states."""
    slopes = np.zeros((6, STATES))
    slopes[:, MOTION:MATRICES] = np.eye(6)
    for a in range(6):
        slopes[a, MATRICES + 3 * a : MATRICES + 3 * a + 3] = inputs[3 * (a // 3) : 3 * (a // 3) + 3]
    return slopes


def _maximum_likelihood(linear: _Linearized, first: Array, levels: NoiseLevels, typical: NoiseLevels) -> NoiseLevels:
    """The noise levels of the largest posterior likelihood, with priors about the typical ones."""
    about, least = np.log(typical), np.log((*MIN_NOISE, *(0.1 * walk for walk in TYPICAL_WALKS), MIN_FIX_NOISE))

    def cost(logs: Array) -> float:
        tried = NoiseLevels(*np.exp(np.maximum(logs, least)))
        return float(
            0.5 * np.sum(((logs - about) / LEVEL_DEVIATIONS) ** 2) - _solved(linear, tried, first).likelihood
        )

    options = {"maxfev": 300, "xatol": 0.05, "fatol": 0.05}
    best = minimize(cost, np.log(levels), method="Nelder-Mead", options=options).x
    return NoiseLevels(*np.exp(np.maximum(best, least)).tolist())


def _solved(linear: _Linearized, levels: NoiseLevels, first: Array) -> _Step:
    """The most probable deviations from the path; ``first`` (n,) are those of the prior mean.

    Motion and biases at the fixes have banded normal equations; the matrices, which border them, are eliminated.

    Raises:
        numpy.linalg.LinAlgError: the process noise or the normal equations are singular.
    """
    count, m = len(linear.innovations), MATRICES
    noise = np.linalg.cholesky(np.tensordot(np.square(levels[:4]), linear.unit_noise, 1))
    ahead = np.linalg.solve(noise, np.broadcast_to(np.eye(m), noise.shape))
    white, shift = ahead @ linear.transition, np.einsum("kij,kj->ki", ahead, linear.shifts)
    behind, matrices = -white[:, :, :m], -white[:, :, m:]
    slopes, innovations = linear.slopes / levels.fixes, linear.innovations / levels.fixes
    prior, goal = PRIOR_DEVIATIONS**-2.0, first * PRIOR_DEVIATIONS**-2.0
    diagonal, border = _products(slopes, slopes), np.zeros((count, m, STATES - m))
    gradient = np.einsum("kri,kr->ki", slopes, innovations)
    diagonal[0] += np.diag(prior[:m])
    gradient[0] += goal[:m]
    for places, part in ((slice(1, None), ahead), (slice(None, -1), behind)):
        diagonal[places] += _products(part, part)
        border[places] += _products(part, matrices)
        gradient[places] += np.einsum("kri,kr->ki", part, shift)
    corner = np.diag(prior[m:]) + _products(matrices, matrices).sum(axis=0)
    rest = goal[m:] + np.einsum("kri,kr->i", matrices, shift)
    band = np.zeros((2 * m, count, m))
    for below, blocks in ((0, diagonal), (m, _products(ahead, behind))):
        for column in range(m):
            rows = np.arange(column if below == 0 else 0, m)
            band[below + rows - column, : len(blocks), column] = blocks[:, rows, column].T
    factor = cholesky_banded(band.reshape(2 * m, -1), lower=True, check_finite=False)
    wanted = np.concatenate((linear.integrals[:, :, :m], np.zeros((1, 6, m)))).transpose(0, 2, 1)
    sides = np.concatenate((border, gradient[:, :, None], wanted), axis=2).reshape(count * m, -1)
    solved = cho_solve_banded((factor, True), sides, check_finite=False)
    edge, sides = solved[:, : STATES - m], sides.T
    complement = corner - sides[: STATES - m] @ edge
    lost = linear.integrals[:, :, m:].sum(axis=0) - sides[STATES - m + 1 :] @ edge
    constants = np.linalg.solve(complement, rest - sides[: STATES - m] @ solved[:, STATES - m])
    moved = solved[:, STATES - m] - edge @ constants
    decrement = float(gradient.ravel() @ moved + rest @ constants)
    squares = float(np.sum(shift**2) + np.sum(innovations**2) + first @ goal) - decrement
    logs = 2.0 * np.sum(np.log(np.diagonal(noise, 0, 1, 2))) + 3.0 * count * np.log(levels.fixes**2)
    logs += 2.0 * np.sum(np.log(factor[0])) + np.linalg.slogdet(complement)[1]
    states = np.hstack((moved.reshape(count, m), np.tile(constants, (count, 1))))
    covariance = sides[STATES - m + 1 :] @ solved[:, STATES - m + 1 :] + lost @ np.linalg.solve(complement, lost.T)
    return _Step(states, math.sqrt(max(decrement, 0.0)), -0.5 * (squares + float(logs)), covariance)


def _products(left: Array, right: Array) -> Array:
    """Products (K, i, j) of ``left`` (K, r, i) transposed and ``right`` (K, r, j)."""
    return np.asarray(np.swapaxes(left, 1, 2) @ right)


# --- result -------------------------------------------------------------------------------------------------


def aided_result(flight: AidedFlight, fit: AidedFit) -> EstimationResult:
    """Biases of the IMU; the fixes and the path's prediction."""
    found = estimates({f"bias_{name}": UNITS[name] for name in INPUTS}, fit.errors, fit.covariance, np.inf)
    imprecise = tuple(
        Finding("imprecise", "warning", one.name, one.standard_error, LARGE_ERRORS[one.unit], {"unit": one.unit})
        for one in found if one.standard_error > LARGE_ERRORS[one.unit]
    )  # fmt: skip
    notes = (Finding("measured_by_gps", "info"), Finding("mean_bias", "info"))
    time = flight.time[flight.at]
    even = np.linspace(time[0], time[-1], len(time))
    series = tuple(
        FitSeries("flight", name, "m/s", even, *(np.interp(even, time, one) for one in pair))
        for name, *pair in zip(VELOCITIES, flight.velocity.T, fit.predicted.T, strict=True)
    )
    return EstimationResult(
        METHOD, "path", "rigid body", (*EQUATIONS, SENSORS), estimates=found, covariance=fit.covariance,
        series=series, samples=len(flight.at), findings=(*notes, *imprecise),
    )  # fmt: skip


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
        details = {"reason": "the smoothed path does not converge"}
        failed = Finding("not_converged", "withheld", METHOD, details=details)
        return EstimationResult(METHOD, "path", status="not converged", findings=(failed,))
    return aided_result(flight, fit)


# --- compiled ------------------------------------------------------------------------------------------------


@njit(cache=True)
def _accumulate(carry: Array, gain: Array, inputs: Array, transition: Array, unit_noise: Array) -> None:
    """Motion at an interval's end by the states at its start, and covariance by unit noise of rates and forces.

    ``carry`` (N, 9, 9) and ``gain`` (N, 9, 6) are the steps' Jacobians, ``inputs`` (2 N + 1, 6) those measured;
    ``transition`` (6, n) and ``unit_noise`` (2, 12, 12) are filled.
    """
    reach, noise = np.zeros((6, transition.shape[1])), np.zeros((2, 6, 6))
    for i in range(6):
        reach[i, i] = 1.0
    for k in range(carry.shape[0]):
        step, push = np.ascontiguousarray(carry[k, :6, :6]), np.ascontiguousarray(gain[k, :6])
        reach = step @ reach
        reach[:, 6:12] -= push
        for a in range(6):
            for b in range(3):
                reach[:, 12 + 3 * a + b] -= push[:, a] * inputs[2 * k + 1, 3 * (a // 3) + b]
        for kind in range(2):
            part = np.ascontiguousarray(push[:, 3 * kind : 3 * kind + 3])
            noise[kind] = step @ noise[kind] @ step.T + part @ part.T
    transition[:] = reach
    unit_noise[:, :6, :6] = noise
