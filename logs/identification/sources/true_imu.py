"""What the IMU of a simulated flight told too much, from the world's own topics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

from logs.identification.data.flight import Aircraft
from logs.identification.models.rigid_body import INPUTS
from logs.identification.results import Array
from logs.identification.sources.full_flight import whole_flight
from logs.identification.sources.topic_table import ColumnSource, TopicTable
from sim_bridge import topics as truth
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

QUATERNION = ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")


def imu_truths(source: ColumnSource, aircraft: Aircraft, spans: Sequence[tuple[float, float]]) -> dict[str, float]:
    """Mean of each rate (rad/s) and specific force (m/s^2) told, less the true one, over the ``spans`` (s); by name.

    As ``bias_p`` and so on: what scales and misalignments add over the same time is in it. Empty where the log is not
    of a simulated flight.
    """
    try:
        true = _true_inputs(source, aircraft)
    except InputError:
        return {}
    flight = whole_flight(source, "flight", aircraft.imu)
    inside = np.any([(flight.time >= begin) & (flight.time <= end) for begin, end in spans], axis=0)
    told = {name: flight.signals[name] - np.interp(flight.time, *true[name]) for name in INPUTS}
    return {f"bias_{name}": float(np.nanmean(errors[inside])) for name, errors in told.items()}


def _true_inputs(source: ColumnSource, aircraft: Aircraft) -> dict[str, tuple[Array, Array]]:
    """Time and value of the true rates and of the specific forces at the IMU's place."""
    rates = ("roll_rate", "pitch_rate", "yaw_rate")
    state = TopicTable(source, truth.STATE, "v_north", "v_east", "v_down", *QUATERNION, *rates)
    to_ned = dcms_from_quaternions(np.column_stack([state[name] for name in QUATERNION]))
    omega = np.column_stack([state[name] for name in rates])
    arm = np.array((aircraft.imu_x, 0.0, aircraft.imu_z))
    v_ned = np.column_stack([state[f"v_{axis}"] for axis in ("north", "east", "down")])
    at_imu = v_ned + np.einsum("nij,nj->ni", to_ned, np.cross(omega, arm))
    felt = CubicSpline(state.time, at_imu)(state.time, 1) - np.array((0.0, 0.0, STANDARD_GRAVITY))
    forces = np.einsum("nji,nj->ni", to_ned, felt)
    return {name: (state.time, column) for name, column in zip(INPUTS, np.hstack((omega, forces)).T, strict=True)}
