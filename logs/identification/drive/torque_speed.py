"""Torque against speed: the line that bounds a servo (Gerdes Fig. 9), and the wing's load on it (Table 5).

A motor at full drive gives ``tau = (tau_s V - tau_s / omega_0 V_n omega) / V_n``: linear in voltage and rate, its
stall torque and no-load speed both in proportion to the voltage. A wing asks for ``tau = c omega`` at a steady rate
(the torque constant of Table 5, N m s/rad); while it flaps, its inertia takes part.
"""

from __future__ import annotations

import numpy as np

from avionics.quantities import BadInput
from logs.identification.data import DriveData
from logs.identification.delta import propagate
from logs.identification.drive.servo import ServoModel
from logs.identification.regression.least_squares import Fit, regress
from logs.identification.results import Array, Estimate, Unidentified, estimate, student_factor

LEAST_SAMPLES = 20
LEAST_SPREAD = 0.05
"""-; of the greatest rate or voltage: what varies less tells no slope of its own"""
CONSTANTS = {"stall_torque": "N m", "no_load_speed": "rad/s", "torque_speed_slope": "N m s/rad"}
LOAD = ("wing_torque_constant", "wing_inertia")


def identify_torque_speed(torque: Array, rate: Array, voltage: Array, nominal: float | None = None) -> ServoModel:
    """Stall torque, no-load speed and slope of a servo at full drive, at ``nominal`` volts (the mean without).

    Args:
        torque: N m; (N,), of one servo driven as hard as it can be, on a bench or in those parts of a flight.
        rate: rad/s; (N,).
        voltage: V; (N,).
        nominal: V.

    Samples that are not finite are left out. Where the voltage does not vary, the line through it is found.

    Raises:
        BadInput: lengths that differ, too few samples.
    """
    columns = [np.asarray(values, dtype=float) for values in (torque, rate, voltage)]
    if len({values.shape for values in columns}) != 1:
        raise BadInput("torque, rate and voltage must have the same number of samples")
    good = np.all(np.isfinite(columns), axis=0)
    if good.sum() < LEAST_SAMPLES:
        raise BadInput(
            f"torque, rate and voltage have {int(good.sum())} samples together; {LEAST_SAMPLES} are needed"
        )
    torque, rate, voltage = (np.where(good, values, 0.0) for values in columns)
    about = float(np.mean(voltage[good])) if nominal is None else nominal
    if about <= 0.0 or np.ptp(np.abs(rate[good])) < LEAST_SPREAD * np.max(np.abs(rate[good])):
        return _refused("the rate does not vary", torque[good])
    design = np.column_stack((voltage / about, -np.abs(rate)))
    try:
        fit = regress(design, torque * turning(torque, rate), good.astype(float))
    except np.linalg.LinAlgError:
        return _refused("voltage and rate do not vary apart", torque[good])
    return _constants(fit, int(good.sum()))


def turning(torque: Array, rate: Array) -> Array:
    """-; (N,), 1 or -1: which way a servo turns at ``rate`` (N,) in rad/s, or pulls where it stands."""
    sign: Array = np.where(rate < 0, -1.0, np.where(rate > 0, 1.0, np.sign(torque)))
    return sign


def _constants(fit: Fit, samples: int) -> ServoModel:
    stall, slope = fit.values
    errors = np.sqrt(np.diag(fit.covariance))
    spread = float(np.std(fit.residuals))
    if not (slope > student_factor(fit.degrees) * errors[1] and stall > 0.0):
        return _refused("the torque does not fall with the rate: the servo was not at its bound", fit.residuals)
    speed, speed_error = propagate(lambda v: np.array([v[0] / v[1]]), fit.values, fit.covariance)
    values = (float(stall), float(speed[0]), float(slope))
    deviations = (float(errors[0]), float(speed_error[0]), float(errors[1]))
    found = tuple(
        estimate(name, unit, value, error, fit.degrees)
        for (name, unit), value, error in zip(CONSTANTS.items(), values, deviations, strict=True)
    )
    return ServoModel(found, (), 0.0, 0.0, spread, samples)


def _refused(why: str, torque: Array) -> ServoModel:
    lost = tuple(Unidentified(name, why) for name in CONSTANTS)
    return ServoModel((), lost, 0.0, 0.0, float(np.std(torque)), len(torque))


def identify_load(data: DriveData) -> ServoModel:
    """The torque constant of Gerdes Table 5 and the wing's inertia, from both wings' torques and motion.

    ``tau = c omega + J omega' + k (angle) + tau_0``: the angle is the rate's integral without its drift. Inertia is
    with the air's apparent mass, and both with what the membrane's twist makes of them at the flapping frequency.

    Raises:
        BadInput: no motion of the wings, too few samples.
    """
    if not len(data.wing_time):
        raise BadInput("the log has no motion of the wings (/main/wing), which the wing's load needs")
    inside = (data.torque_time >= data.wing_time[0]) & (data.torque_time <= data.wing_time[-1])
    if inside.sum() < LEAST_SAMPLES:
        raise BadInput(f"the log has {int(inside.sum())} torque readings while the wings' motion is known")
    sides = ((data.torque_left, data.rate_left), (data.torque_right, data.rate_right))
    rows = [_side(data, torque, rate, inside) for torque, rate in sides]
    moving = np.concatenate([row[1] for row in rows])
    if float(np.ptp(moving)) < 1.0:
        lost = tuple(Unidentified(name, "the wings do not move") for name in LOAD)
        return ServoModel((), lost, 0.0, 0.0, 0.0, int(inside.sum()))
    fits = [regress(np.column_stack(row[1:]), row[0], np.ones(len(row[0]))) for row in rows]
    return _mean_load(fits, int(inside.sum()))


def _side(data: DriveData, torque: Array, rate: Array, inside: Array) -> tuple[Array, ...]:
    """Torque, and what it is regressed on: rate, acceleration, angle, one."""
    time, at = data.wing_time, data.torque_time[inside]
    step = np.diff(time, prepend=time[0])
    swept = np.cumsum(rate * step)
    angle = swept - np.polyval(np.polyfit(time - time[0], swept, 1), time - time[0])
    columns = (rate, np.gradient(rate, time), angle)
    return (torque[inside], *(np.interp(at, time, column) for column in columns), np.ones(len(at)))


def _mean_load(fits: list[Fit], samples: int) -> ServoModel:
    """Mean of the two wings; their difference is part of the error."""
    found: list[Estimate] = []
    for index, (name, unit) in enumerate(zip(LOAD, ("N m s/rad", "kg m^2"), strict=True)):
        values = np.array([fit.values[index] for fit in fits])
        own = float(np.mean([fit.covariance[index, index] for fit in fits])) / 2.0
        error = np.sqrt(own + float(np.var(values, ddof=1)) / 2.0)
        found.append(estimate(name, unit, float(values.mean()), float(error), min(fit.degrees for fit in fits)))
    spread = float(np.sqrt(np.mean([np.var(fit.residuals) for fit in fits])))
    kept = tuple(e for e in found if e.low * e.high > 0.0)
    lost = tuple(Unidentified(e.name, "its 95 % interval spans zero") for e in found if e not in kept)
    return ServoModel(kept, lost, 0.0, 0.0, spread, samples)
