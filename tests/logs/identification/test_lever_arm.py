"""Lever arms: specific force and flow of a rotating rigid body at the center of mass."""

from __future__ import annotations

import numpy as np

from logs.identification.models.rigid_body import acceleration_at_center, flow_of

PLACE = (0.3, -0.1, 0.05)


def test_a_body_that_spins_about_its_centre_feels_nothing_there() -> None:
    """GIVEN rotation by a known angle about a fixed axis THEN the IMU's circle is taken off to rounding."""
    time = np.arange(0, 5, 0.01)
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    rate, change = 3 + np.sin(2 * time), 2 * np.cos(2 * time)
    omega, omega_dot = np.outer(rate, axis), np.outer(change, axis)
    across = np.asarray(PLACE) - axis * (axis @ PLACE)
    circle = np.outer(change, np.cross(axis, PLACE)) - np.outer(rate**2, across)
    np.testing.assert_allclose(acceleration_at_center(circle, omega, omega_dot, PLACE), 0, atol=1e-12)


def test_the_acceleration_is_the_second_derivative_of_the_place() -> None:
    """GIVEN a pitching, plunging body WHEN its IMU's path is differentiated twice THEN the plunge is left."""
    time = np.arange(0, 4, 1e-3)
    angle, plunge = 0.4 * np.sin(3 * time), 0.2 * np.cos(5 * time)
    x = PLACE[0] * np.cos(angle) + PLACE[2] * np.sin(angle)
    z = -PLACE[0] * np.sin(angle) + PLACE[2] * np.cos(angle) + plunge
    a_x, a_z = (np.gradient(np.gradient(each, time), time) for each in (x, z))
    body = np.column_stack(
        (a_x * np.cos(angle) - a_z * np.sin(angle), 0 * time, a_x * np.sin(angle) + a_z * np.cos(angle))
    )
    omega = np.column_stack((0 * time, 1.2 * np.cos(3 * time), 0 * time))
    omega_dot = np.column_stack((0 * time, -3.6 * np.sin(3 * time), 0 * time))
    centre = acceleration_at_center(body, omega, omega_dot, PLACE)
    plunging = -5 * np.cos(5 * time)
    wanted = np.column_stack((-plunging * np.sin(angle), 0 * time, plunging * np.cos(angle)))
    np.testing.assert_allclose(centre[5:-5], wanted[5:-5], atol=2e-4)


def test_the_flow_of_a_velocity() -> None:
    velocity = np.array([[15.0, 2.0, 3.0], [10.0, -4.0, -1.0]])
    airspeed, alpha, beta = (flow_of(velocity, name) for name in ("airspeed", "alpha", "beta"))
    ahead = airspeed * np.cos(beta)
    back = np.column_stack((ahead * np.cos(alpha), airspeed * np.sin(beta), ahead * np.sin(alpha)))
    np.testing.assert_allclose(back, velocity, atol=1e-12)
