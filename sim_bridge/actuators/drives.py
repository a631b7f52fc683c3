"""Wing drives: position servos limited by torque and speed, their current, the battery."""

from __future__ import annotations

from sim_bridge.compiled import kernel


@kernel
def torque_bound(rate: float, direction: float, stall_torque: float, no_load_speed: float) -> float:
    """Maximum torque in N m of a servo along ``direction`` (+1, -1) at ``rate`` rad/s.

    The straight torque-speed line of a motor (Gerdes Fig. 9's bandwidth line); braking is bounded by the stall
    torque.
    """
    share = 1.0 - rate * direction / no_load_speed
    return stall_torque * min(max(share, 0.0), 1.0)


@kernel
def servo_torque(
    angle_error: float,
    rate_error: float,
    rate: float,
    gains: tuple[float, float],
    stall_torque: float,
    no_load_speed: float,
) -> float:
    """Torque in N m of a position servo: PD gains (N m/rad, N m s/rad), limited by `torque_bound`."""
    wanted = gains[0] * angle_error + gains[1] * rate_error
    direction = 1.0 if wanted >= 0.0 else -1.0
    bound = torque_bound(rate, direction, stall_torque, no_load_speed)
    return direction * min(abs(wanted), bound)


@kernel
def drive_current(torque: float, torque_constant: float, torque_offset: float, idle_current: float) -> float:
    """PWM-mean current in A of one of two drives at ``torque`` N m.

    Inverse of Gerdes Eq. 11, ``tau = K_tau I + K_tau0`` with tau the mean torque of the two drives and I
    their total current, so that one drive alone has twice the constant; never below the idle current.
    """
    return max((abs(torque) - torque_offset) / (2.0 * torque_constant), idle_current)
