"""What Gerdes, Bruck, Gupta 2017 print of their four wings: Tables 3 to 7."""

from __future__ import annotations

from typing import NamedTuple


class ModelFigures(NamedTuple):
    """Table 7, kinematics only: the paper's model with the exact commanded stroke."""

    lift: float
    """N; mean"""
    thrust: float
    """N; mean"""
    power: float
    """W; mean"""
    torque: float
    """N m; mean"""


class CoupledFigures(NamedTuple):
    """Table 7, coupled model: the paper's model with motor limits and wing twist."""

    power: float
    """W; mean"""
    torque: float
    """N m; mean"""
    plunge_speed: float
    """rad/s; maximum"""


class WingFigures(NamedTuple):
    """Published data of one wing design and its flight."""

    semispan: float
    """m; Table 3"""
    chord: float
    """m; maximum, Table 3"""
    area: float
    """m^2; Table 3"""
    climb_rate: float
    """m/s, Table 4"""
    angle_of_attack: float
    """rad, Table 4"""
    airspeed: float
    """m/s, Table 4"""
    weight: float
    """kg, all-up, Table 4"""
    amplitude: float
    """rad, peak to peak, Table 4"""
    current: float
    """A, mean, Table 4"""
    box: float
    """m^2; Table 5"""
    torque_constant: float
    """N m s/rad; torque over steady plunge speed, Table 5"""
    overshoot: float
    """-, Table 6"""
    power: float
    """W, mean, Table 7, flight testing"""
    torque: float
    """N m, mean, Table 7, flight testing"""
    plunge_speed: float
    """rad/s, maximum, Table 7, flight testing"""
    lift: float
    """N, mean, Table 7, coupled model"""
    thrust: float
    """N, mean, Table 7, coupled model"""
    fixed_body: ModelFigures
    coupled: CoupledFigures
    steady_speed: float
    """rad/s; plunge speed after the overshoot, Table 6"""
    damping_ratio: float
    """-; of the twist, Table 6"""


WINGS = {
    "A": WingFigures(
        0.527, 0.311, 0.113, 0.489, 0.879, 5.54, 0.312, 1.137, 2.54, 0.1640, 0.0595, 0.0020,
        13.6, 0.99, 14.69, 2.50, 1.16, ModelFigures(2.51, 1.16, 13.0, 1.43),
        CoupledFigures(12.9, 0.70, 16.69), 9.47, 0.96,
    ),
    "B": WingFigures(
        0.622, 0.356, 0.171, 0.758, 0.839, 4.80, 0.329, 1.062, 2.85, 0.2213, 0.1127, 0.1080,
        15.1, 1.05, 14.04, 3.08, 1.15, ModelFigures(4.03, 2.88, 29.8, 2.30),
        CoupledFigures(18.3, 1.02, 15.02), 9.37, 0.58,
    ),
    "C": WingFigures(
        0.667, 0.394, 0.210, 0.851, 0.390, 6.42, 0.329, 1.049, 2.93, 0.2625, 0.1439, 0.2018,
        15.9, 1.06, 13.60, 3.19, 1.37, ModelFigures(4.75, 3.95, 39.9, 2.70),
        CoupledFigures(20.0, 1.15, 12.96), 9.12, 0.45,
    ),
    "D": WingFigures(
        0.762, 0.432, 0.280, 0.395, 0.585, 7.75, 0.359, 1.032, 3.26, 0.3290, 0.2002, 0.3650,
        17.6, 1.17, 12.61, 3.31, 2.19, ModelFigures(6.42, 7.15, 70.9, 3.64),
        CoupledFigures(22.1, 1.31, 11.56), 8.41, 0.31,
    ),
}  # fmt: skip
"""by the letter of the wing"""
