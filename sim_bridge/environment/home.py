"""Launch site of a flight."""

from __future__ import annotations

import math
from typing import NamedTuple

from sim_bridge.environment.magnetic import MagneticField


class Home(NamedTuple):
    """Launch site on the ground: origin of the local NED axes, at least 5 degrees from a pole."""

    latitude: float
    """rad; WGS-84"""
    longitude: float
    """rad; WGS-84, -pi to pi"""
    altitude: float
    """m; above mean sea level (the geoid is taken as the ellipsoid)"""
    magnetic: MagneticField
    """of the place"""


COLLEGE_PARK = Home(
    math.radians(38.99),
    math.radians(-76.94),
    20.0,
    MagneticField(math.radians(-10.5), math.radians(65.0), 0.506),
)
"""College Park, Maryland, where Gerdes's university is (chosen: the papers name no test field).

Magnetic field: chosen, rounded from the geomagnetic reference field interpolated at the place by pymavlink's
``mavextra.get_mag_field_ef`` (-10.52 deg, 64.96 deg, 0.5059 G).
"""
