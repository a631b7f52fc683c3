"""The wings' coefficients from a log: ``wingbeat identify FILE aero``."""

from __future__ import annotations

from logs.identification.data.flight import NEUTRAL, ImuCalibration
from logs.identification.estimators.wing_coefficients import AeroResult, identify_coefficients
from logs.identification.models.inverse_dynamics import LOW_PASS, coefficients
from logs.identification.sources.motion import measured_motion, true_motion
from logs.identification.sources.topic_table import ColumnSource
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError


def identify_aero(
    source: ColumnSource,
    vehicle: SimulatedVehicle | None,
    calibration: ImuCalibration = NEUTRAL,
    by_truth: bool = False,
) -> AeroResult:
    """Structure and parameters of C_L, C_T and C_m (Grauer Eq. 13 to 19) from the flapping flight in a log.

    From what the vehicle measured, or ``by_truth`` from the truth of a simulated flight. Masses, hinges and tail are
    the ``vehicle``'s.

    Raises:
        InputError: the vehicle is not known, a topic is missing, or the flight has no stretch that is long enough.
    """
    if vehicle is None:
        raise InputError(
            "inverse dynamics needs the masses and hinges of the vehicle, and the log carries no file of it"
        )
    flown = true_motion(source, vehicle) if by_truth else measured_motion(source, vehicle, calibration)
    return identify_coefficients(tuple(coefficients(vehicle, one, LOW_PASS) for one in flown))
