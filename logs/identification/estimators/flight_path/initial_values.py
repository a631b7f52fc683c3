"""Where the search for a flight path begins, also where no attitude was measured.

Gravity in the first body axes follows from rates, specific forces and the flow alone. With R(t) from the body axes at
t to the first ones (the rates' integral), f the specific force and v the velocity through steady air, the kinematics
(Klein & Morelli, Aircraft System Identification, 2006, Eq. 10.1) integrate to

    R(t) v(t) - int R f dt = v(0) + g t,

which is linear in v(0) and g, and of which g gives bank and pitch at the start. Over longer spans the noise of the
flow counts less and the bias of the gyros more, so there is a start of each of several.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from logs.identification.estimators.flight_path.records import LEAST_SAMPLES, Problem, Record, Values
from logs.identification.models.rigid_body import STATES
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

SPANS = (8.0, 2.0, 32.0)
"""s; from the start, that gravity is found over"""


def starts_of(problem: Problem) -> list[Values]:
    """No errors of any sensor, and first states: one guess, or one for each span without an attitude."""
    guesses: list[Values] = []
    for span in SPANS:
        rows = np.array([_start(problem, record, span) for record in problem.records])
        if not any(np.allclose(rows, guess.starts) for guess in guesses):
            guesses.append(Values(np.zeros(len(problem.parameters)), rows))
    return guesses


def _start(problem: Problem, record: Record, span: float) -> Array:
    """First states from the first samples of each output, an attitude not measured by gravity over ``span`` s."""
    told = {name: values[used > 0][0] for name, values, used in
            zip(problem.channels, record.outputs.T, record.used.T, strict=True) if np.any(used)}  # fmt: skip
    # In steady flight the specific force along x is gravity's.
    level = float(np.arcsin(np.clip(np.mean(record.inputs[:, 3]) / STANDARD_GRAVITY, -0.9, 0.9)))
    bank, pitch = _attitude(problem, record, span, level)
    theta, phi = told.get("theta", pitch), told.get("phi", bank)
    climb = np.arcsin(np.clip(told.get("climb_rate", 0.0) / max(told["airspeed"], 1e-6), -1, 1))
    alpha, beta = told.get("alpha", theta - climb), told.get("beta", 0.0)
    rest = [told.get(name, 0.0) for name in ("psi", "altitude", "north", "east")]
    return np.array([*_velocity(told["airspeed"], alpha, beta), phi, theta, *rest])


def _velocity(speed: Array, alpha: Array, beta: Array) -> Array:
    """(m/s; FRD) at flow angles alpha = atan2(w, u) and beta = asin(v / V)."""
    ahead = speed * np.cos(beta)
    velocity: Array = np.stack((ahead * np.cos(alpha), speed * np.sin(beta), ahead * np.sin(alpha)), axis=-1)
    return velocity


def _attitude(problem: Problem, record: Record, span: float, level: float) -> tuple[float, float]:
    """Bank and pitch (rad) at the start; wings level at the pitch ``level`` where the flow was not measured."""
    three = ("airspeed", "alpha", "beta") if "beta" in problem.channels else ("airspeed", "alpha")
    # Of the longitudinal motion alone no bank is free, and its inputs tell none.
    if STATES.index("phi") not in problem.free or not set(three) <= set(problem.channels):
        return 0.0, level
    columns = [problem.channels.index(name) for name in three]
    known = np.all(record.used[:, columns] > 0, axis=1) & (record.time - record.time[0] <= span)
    if np.count_nonzero(known) < LEAST_SAMPLES // 2:
        return 0.0, level
    return _by_gravity(record, [record.outputs[:, column] for column in columns], known)


def _by_gravity(record: Record, flow: list[Array], known: Array) -> tuple[float, float]:
    """Bank and pitch (rad) of gravity in the first body axes, the flow sideways nothing where not measured."""
    stop = int(np.flatnonzero(known)[-1]) + 1
    rates, forces = record.inputs[:stop, :3], record.inputs[:stop, 3:]
    turns = Rotation.from_rotvec((rates[1:] + rates[:-1]) / 2.0 * record.step)
    attitude = [Rotation.identity()]
    for turn in turns:
        attitude.append(attitude[-1] * turn)
    first = Rotation.concatenate(attitude)
    sideways = flow[2][:stop] if len(flow) > 2 else np.zeros(stop)
    velocity = first.apply(_velocity(flow[0][:stop], flow[1][:stop], sideways))
    felt = first.apply(forces)
    gained = np.vstack((np.zeros(3), np.cumsum((felt[1:] + felt[:-1]) / 2.0 * record.step, axis=0)))
    elapsed = record.time[:stop] - record.time[0]
    rows = known[:stop]
    line = np.column_stack((np.ones(stop), elapsed))[rows]
    down = np.linalg.lstsq(line, (velocity - gained)[rows], rcond=None)[0][1]
    return float(np.arctan2(down[1], down[2])), float(np.arctan2(-down[0], np.hypot(down[1], down[2])))
