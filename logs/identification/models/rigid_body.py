"""Motion of a point of a rigid body from its rates and specific forces, as its sensors measure it.

Klein & Morelli, Aircraft System Identification, 2006, chapter 10: with the specific force f at that point,
``v' = f + g(phi, theta) - omega x v``, the Euler angles' rates from omega, and the position's from v, without
aerodynamics and mass. The integration is of fourth order (Runge-Kutta), the inputs cubic between samples.

Every sensor measures (1 + scale) times the truth plus a bias; the air moves steadily and level. The states are those
of the IMU's position, so that its specific forces need no angular acceleration; vanes and pitot measure the flow at
their own positions.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from logs.identification.estimators.engine.problem import Intersample, Named
from logs.identification.results import Array
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY

STATES = ("u", "v", "w", "phi", "theta", "psi", "altitude", "north", "east")
STATE_UNITS = ("m/s", "m/s", "m/s", "rad", "rad", "rad", "m", "m", "m")
INPUTS = ("p", "q", "r", "a_x", "a_y", "a_z")
DYNAMIC = 6
"""-; states that others depend on, the first of `STATES`"""
LONGITUDINAL_STATES = ("u", "w", "theta", "altitude")
LONGITUDINAL_INPUTS = ("q", "a_x", "a_z")
OUTPUTS = ("airspeed", "alpha", "beta", "phi", "theta", "psi", "altitude", "climb_rate", "north", "east")
LONGITUDINAL_OUTPUTS = ("airspeed", "alpha", "theta", "altitude", "climb_rate")
UNITS = {
    **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("a_x", "a_y", "a_z"), "m/s^2"),
    **dict.fromkeys(("airspeed", "climb_rate"), "m/s"),
    **dict.fromkeys(("alpha", "beta", "phi", "theta", "psi"), "rad"),
    **dict.fromkeys(("altitude", "north", "east"), "m"),
}
WINDS = ("wind_north", "wind_east")
SAMPLE = "sample"
SPEED_UNITS = {"kn": 3600.0 / 1852.0, "mph": 2.2369, "ft/s": 3.2808, "km/h": 3.6}
"""-; number in the unit by number in m/s"""
Position = tuple[float, float, float]


class SensorPositions(NamedTuple):
    """Positions of the sensors from the center of mass, FRD, m."""

    imu: Position = (0.0, 0.0, 0.0)
    airspeed: Position = (0.0, 0.0, 0.0)
    alpha: Position = (0.0, 0.0, 0.0)
    beta: Position = (0.0, 0.0, 0.0)


class Feedback(NamedTuple):
    """Measured outputs that correct the states after every sample."""

    outputs: tuple[str, ...]
    measured: Array
    """(N, m); NaN if not measured"""
    gains: Array
    """(N, 9, m); of the states by the innovations"""


class RigidBody(NamedTuple):
    """A `problem.Model` of the kinematics: parameters ``bias_CHANNEL``, ``scale_CHANNEL`` and `WINDS`."""

    positions: SensorPositions = SensorPositions()
    longitudinal: bool = False
    """-; u, w, theta and altitude from q, a_x and a_z: flight with level wings"""

    @property
    def states(self) -> Mapping[str, Named]:
        """Velocity through the air, attitude and position."""
        return {name: Named(unit) for name, unit in zip(STATES, STATE_UNITS, strict=True)}

    @property
    def inputs(self) -> Mapping[str, str]:
        """Measured rates and specific forces."""
        return {name: UNITS[name] for name in (LONGITUDINAL_INPUTS if self.longitudinal else INPUTS)}

    @property
    def outputs(self) -> Mapping[str, str]:
        """Airspeed and flow angles at their sensors, attitude, position and climb rate."""
        return {name: UNITS[name] for name in (LONGITUDINAL_OUTPUTS if self.longitudinal else OUTPUTS)}

    @property
    def parameters(self) -> Mapping[str, Named]:
        """Errors of the sensors, and the wind."""
        channels = (*self.inputs, *self.outputs)
        errors = {f"{kind}_{name}": Named(UNITS[name] if kind == "bias" else "-")
                  for kind in ("bias", "scale") for name in channels}  # fmt: skip
        return errors | ({} if self.longitudinal else dict.fromkeys(WINDS, Named("m/s")))

    def simulate(
        self,
        parameters: Array,
        start: Array,
        inputs: Array,
        step: float,
        intersample: Intersample | None = None,
        /,
    ) -> Array:
        """Outputs (N, m) with the sensors' errors; see `problem.Model`. No input is a zero-order hold."""
        return self.motion(parameters, start, inputs, step).outputs

    def motion(
        self, parameters: Array, start: Array, inputs: Array, step: float, feedback: Feedback | None = None
    ) -> Motion:
        """The motion of one record; with ``feedback`` its outputs are one-step-ahead predictions."""
        count, channels = len(self.inputs), len(self.inputs) + len(self.outputs)
        corrected = np.zeros((len(inputs), 6))
        columns = [INPUTS.index(name) for name in self.inputs]
        with np.errstate(all="ignore"):  # a motion that diverges gives values that are not finite
            corrected[:, columns] = (inputs - parameters[:count]) / (1.0 + parameters[channels:][:count])
        errors = np.zeros((2, len(OUTPUTS)))
        places = [OUTPUTS.index(name) for name in self.outputs]
        errors[:, places] = parameters[count:channels], parameters[channels + count : 2 * channels]
        wind = np.zeros(2) if self.longitudinal else np.ascontiguousarray(parameters[-2:])
        back = feedback or Feedback((), np.empty((len(inputs), 0)), np.empty((len(inputs), 9, 0)))
        corrected_by = np.array([OUTPUTS.index(name) for name in back.outputs], dtype=np.int64)
        states, outputs = np.empty((len(inputs), 9)), np.empty((len(inputs), len(OUTPUTS)))
        dense = with_middles(corrected)
        _predict(
            start, dense, step, STANDARD_GRAVITY, self._arms, errors, wind, corrected_by, back.measured, back.gains,
            states, outputs,
        )  # fmt: skip
        return Motion(states, corrected, outputs[:, places])

    @property
    def _arms(self) -> Array:
        """From the IMU to the sensors of the flow (3, 3)."""
        return np.array([np.subtract(getattr(self.positions, name), self.positions.imu) for name in OUTPUTS[:3]])

    def output_slopes(self, states: Array, inputs: Array) -> Array:
        """Jacobian (N, m, 9) of the outputs of sensors without errors, by the states."""
        places = [OUTPUTS.index(name) for name in self.outputs]
        slopes = np.empty((len(states), len(OUTPUTS), 9))
        _output_slopes(states, inputs, self._arms, slopes)
        return slopes[:, places]


class RigidBodyFilter(NamedTuple):
    """A `problem.Predictor`: the kinematics with an extended Kalman filter of given gains."""

    body: RigidBody
    fitted: tuple[str, ...]
    """-; (m,), outputs that correct the states"""
    gains: Array
    """(M, 9, m); of all records, one after the other; input `SAMPLE` is the row"""

    @property
    def states(self) -> Mapping[str, Named]:
        """Those of the kinematics."""
        return self.body.states

    @property
    def inputs(self) -> Mapping[str, str]:
        """Those of the kinematics, and `SAMPLE`."""
        return dict(self.body.inputs) | {SAMPLE: "-"}

    @property
    def outputs(self) -> Mapping[str, str]:
        """Those of the kinematics."""
        return self.body.outputs

    @property
    def parameters(self) -> Mapping[str, Named]:
        """Those of the kinematics."""
        return self.body.parameters

    def simulate(
        self,
        parameters: Array,
        start: Array,
        inputs: Array,
        step: float,
        intersample: Intersample | None = None,
        /,
    ) -> Array:
        """Outputs (N, m) without the filter."""
        return self.body.simulate(parameters, start, inputs[:, :-1], step)

    def predict(self, parameters: Array, start: Array, inputs: Array, measured: Array, step: float) -> Array:
        """Outputs (N, m) of `fitted`, each predicted from the samples before."""
        columns = [list(self.outputs).index(name) for name in self.fitted]
        return self.motion(parameters, start, inputs, measured, step).outputs[:, columns]

    def motion(self, parameters: Array, start: Array, inputs: Array, measured: Array, step: float) -> Motion:
        """The filtered motion of one record."""
        feedback = Feedback(self.fitted, measured, self.gains[inputs[:, -1].astype(np.intp)])
        return self.body.motion(parameters, start, inputs[:, :-1], step, feedback)


class Motion(NamedTuple):
    """A record's motion."""

    states: Array
    """(N, 9); after the correction by the measurements, if there is any"""
    inputs: Array
    """(N, 6); without their errors"""
    outputs: Array
    """(N, m); with the sensors' errors, before the correction"""


@njit(cache=True)
def _output(x: Array, inputs: Array, arms: Array, out: Array) -> None:
    """Outputs (10,) of sensors without errors at states (9,) and inputs (6,)."""
    p, q, r = inputs[0], inputs[1], inputs[2]
    for sensor in range(3):
        ax, ay, az = arms[sensor, 0], arms[sensor, 1], arms[sensor, 2]
        u, v, w = x[0] + q * az - r * ay, x[1] + r * ax - p * az, x[2] + p * ay - q * ax
        speed = np.sqrt(u * u + v * v + w * w)
        if sensor == 0:
            out[0] = speed
        elif sensor == 1:
            out[1] = np.arctan2(w, u)
        else:
            out[2] = np.arcsin(v / max(speed, 1e-9))
    for i in range(4):
        out[3 + i] = x[3 + i]
    sin_phi, cos_phi, sin_theta, cos_theta = np.sin(x[3]), np.cos(x[3]), np.sin(x[4]), np.cos(x[4])
    out[7] = x[0] * sin_theta - (x[1] * sin_phi + x[2] * cos_phi) * cos_theta
    out[8], out[9] = x[7], x[8]


@njit(cache=True)
def _predict(
    start: Array, inputs: Array, dt: float, gravity: float, arms: Array, errors: Array, wind: Array,
    places: NDArray[np.int64], measured: Array, gains: Array, states: Array, outputs: Array,
) -> None:  # fmt: skip
    """States and outputs of the kinematics, corrected by the measured outputs after every sample."""
    work, x, ahead = np.zeros((2, 9)), start.copy(), np.empty(9)
    for k in range(states.shape[0]):
        _output(x, inputs[2 * k], arms, outputs[k])
        outputs[k, 8] += k * dt * wind[0]
        outputs[k, 9] += k * dt * wind[1]
        for j in range(outputs.shape[1]):
            outputs[k, j] = (1.0 + errors[1, j]) * outputs[k, j] + errors[0, j]
        for j in range(measured.shape[1]):
            innovation = measured[k, j] - outputs[k, places[j]]
            for i in range(9 if np.isfinite(innovation) else 0):
                x[i] += gains[k, i, j] * innovation
        states[k] = x
        if k + 1 < states.shape[0]:
            _step(x, inputs[2 * k : 2 * k + 3], dt, gravity, work, ahead)
            x[:] = ahead


@njit(cache=True)
def _output_slopes(states: Array, inputs: Array, arms: Array, slopes: Array) -> None:
    x, ahead, behind = np.empty(9), np.empty(10), np.empty(10)
    for k in range(states.shape[0]):
        for i in range(9):
            x[:] = states[k]
            x[i] += 1e-5
            _output(x, inputs[k], arms, ahead)
            x[i] -= 2e-5
            _output(x, inputs[k], arms, behind)
            for j in range(10):
                slopes[k, j, i] = (ahead[j] - behind[j]) / 2e-5


@njit(cache=True)
def kalman_gains(carry: Array, noise: Array, slopes: Array, variances: Array) -> Array:
    """Gains (N, 9, m) of the extended Kalman filter from known initial states.

    ``carry`` (N - 1, 9, 9) are the Jacobians of every step, ``noise`` (N - 1, 9, 9) what the inputs' noise adds,
    ``slopes`` (N, m, 9) the outputs' Jacobians, ``variances`` (N, m) their noise, infinite if not measured. The
    outputs of a sample are taken one after the other; the gains are those to the prediction of all of them.
    """
    count, outputs = slopes.shape[0], slopes.shape[1]
    covariance, gains = np.zeros((9, 9)), np.zeros((count, 9, outputs))
    for k in range(count):
        for j in range(outputs):
            if np.isfinite(variances[k, j]):
                row = np.ascontiguousarray(slopes[k, j])
                reach = covariance @ row
                gain = reach / (row @ reach + variances[k, j])
                # x + K_j (y_j - h_j (x + earlier corrections))
                for i in range(j):
                    gains[k, :, i] -= gain * (row @ np.ascontiguousarray(gains[k, :, i]))
                gains[k, :, j] = gain
                covariance -= np.outer(gain, reach)
        if k + 1 < count:
            step = np.ascontiguousarray(carry[k])
            covariance = step @ covariance @ step.T + noise[k]
    return gains


def velocity_at(velocity: Array, rates: Array, position: Position, imu: Position) -> Array:
    """Velocity (m/s; (N, 3), FRD) at a ``position`` from that at ``imu``; ``rates`` are p, q, r (N, 3)."""
    moved: Array = velocity + np.cross(rates, np.subtract(position, imu))
    return moved


def acceleration_at_center(measured: Array, omega: Array, omega_dot: Array, position: Position) -> Array:
    """Specific force (m/s^2; (N, 3), FRD) at the center of mass from that ``measured`` (N, 3) at a ``position``.

    A point of a rigid body at r accelerates with ``a + omega' x r + omega x (omega x r)``. ``omega`` (rad/s) and
    ``omega_dot`` (rad/s^2) are (N, 3), FRD.
    """
    r = np.asarray(position, dtype=np.float64)
    moved: Array = measured - np.cross(omega_dot, r) - np.cross(omega, np.cross(omega, r))
    return moved


def flow_of(velocity: Array, name: str) -> Array:
    """Airspeed (m/s), alpha = atan2(w, u) or beta = asin(v / V) (rad) of a ``velocity`` (m/s; (N, 3), FRD)."""
    if name == "alpha":
        return np.asarray(np.arctan2(velocity[:, 2], velocity[:, 0]))
    speed = np.sqrt(np.sum(velocity**2, axis=1))
    return np.asarray(speed if name == "airspeed" else np.arcsin(velocity[:, 1] / np.maximum(speed, 1e-9)))


# --- integration --------------------------------------------------------------------------------------------


@njit(cache=True)
def _slopes(x: Array, inputs: Array, gravity: float, out: Array) -> None:
    u, v, w, p, q, r = x[0], x[1], x[2], inputs[0], inputs[1], inputs[2]
    sin_phi, cos_phi, sin_theta, cos_theta = np.sin(x[3]), np.cos(x[3]), np.sin(x[4]), np.cos(x[4])
    sin_psi, cos_psi = np.sin(x[5]), np.cos(x[5])
    turn = q * sin_phi + r * cos_phi
    out[0] = inputs[3] - gravity * sin_theta + r * v - q * w
    out[1] = inputs[4] + gravity * cos_theta * sin_phi + p * w - r * u
    out[2] = inputs[5] + gravity * cos_theta * cos_phi + q * u - p * v
    out[3] = p + turn * sin_theta / cos_theta
    out[4] = q * cos_phi - r * sin_phi
    out[5] = turn / cos_theta
    sunk = v * sin_phi + w * cos_phi
    across = v * cos_phi - w * sin_phi
    ahead = u * cos_theta + sunk * sin_theta
    out[6] = u * sin_theta - sunk * cos_theta
    out[7] = ahead * cos_psi - across * sin_psi
    out[8] = ahead * sin_psi + across * cos_psi


@njit(cache=True)
def _step(x: Array, inputs: Array, dt: float, gravity: float, work: Array, out: Array) -> None:
    """One step of Runge-Kutta from ``x`` (9,), ``inputs`` (3, 6) at its begin, middle and end; ``work`` is (2, 9)."""
    slope, trial = work[0], work[1]
    for i in range(9):
        out[i] = trial[i] = x[i]
    for stage in range(4):
        _slopes(trial, inputs[(stage + 1) // 2], gravity, slope)
        share = dt / 6 if stage == 0 or stage == 3 else dt / 3
        ahead = dt if stage == 2 else dt / 2
        for i in range(9):
            out[i] += share * slope[i]
            trial[i] = x[i] + ahead * slope[i]


@njit(cache=True)
def _integrate(inputs: Array, dt: float, gravity: float, states: Array) -> None:
    work = np.zeros((2, 9))
    for k in range(states.shape[0] - 1):
        _step(states[k], inputs[2 * k : 2 * k + 3], dt, gravity, work, states[k + 1])


@njit(cache=True)
def _linearize(states: Array, inputs: Array, dt: float, gravity: float, carry: Array, gain: Array) -> None:
    """Jacobians of every step by state (N - 1, 9, 9) and by inputs that shift all along it (N - 1, 9, 6)."""
    work, ends, x, near = np.zeros((2, 9)), np.zeros((2, 9)), np.zeros(9), np.zeros((3, 6))
    for k in range(states.shape[0] - 1):
        for j in range(12):
            width = 1e-4 if j < 3 else 1e-5
            for side in range(2):
                shift = width if side == 0 else -width
                for i in range(9):
                    x[i] = states[k, i] + (shift if i == j and j < DYNAMIC else 0.0)
                for n in range(3):
                    for i in range(6):
                        near[n, i] = inputs[2 * k + n, i] + (shift if i == j - DYNAMIC else 0.0)
                _step(x, near, dt, gravity, work, ends[side])
            for i in range(9):
                slope = (ends[0, i] - ends[1, i]) / (2 * width)
                if j < DYNAMIC:
                    carry[k, i, j] = slope
                else:
                    gain[k, i, j - DYNAMIC] = slope
        for i in range(6, 9):
            carry[k, i, i] = 1.0


def with_middles(inputs: Array) -> Array:
    """Inputs (2 N - 1, 6) with those half way between the samples (N, 6), by cubics through four of them."""
    dense = np.empty((2 * len(inputs) - 1, 6))
    dense[::2] = inputs
    dense[1::2] = (inputs[1:] + inputs[:-1]) / 2
    dense[3:-3:2] += (inputs[1:-2] + inputs[2:-1] - inputs[:-3] - inputs[3:]) / 16
    return dense


def integrate(start: Array, inputs: Array, dt: float, gravity: float) -> Array:
    """States (N, 9) as in `STATES` from ``start`` (9,), ``dt`` s apart, under inputs (2 N - 1, 6) `with_middles`."""
    states = np.zeros((len(inputs) // 2 + 1, 9))
    states[0] = start
    _integrate(inputs, dt, gravity, states)
    return states


def linearize(states: Array, inputs: Array, dt: float, gravity: float) -> tuple[Array, Array]:
    """Jacobians of every step along ``states`` (N, 9) under inputs (2 N - 1, 6) `with_middles`.

    By the state before it (N - 1, 9, 9) and by the inputs over it (N - 1, 9, 6).
    """
    carry, gain = np.zeros((len(states) - 1, 9, 9)), np.zeros((len(states) - 1, 9, 6))
    _linearize(states, inputs, dt, gravity, carry, gain)
    return carry, gain
