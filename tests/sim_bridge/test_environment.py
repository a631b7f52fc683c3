from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavextra

from sim_bridge.environment import geodesy
from sim_bridge.environment.geodesy import geodetic_from_ned, ned_from_geodetic
from sim_bridge.environment.home import COLLEGE_PARK, Home
from sim_bridge.environment.magnetic import MagneticField, field_ned
from sim_bridge.environment.wind import steady_wind
from wingbeat.errors import InputError

places = st.builds(
    Home,
    st.floats(-math.radians(80.0), math.radians(80.0)),
    st.floats(-math.pi, math.pi),
    st.floats(-100.0, 3000.0),
    st.just(COLLEGE_PARK.magnetic),
)
metres = st.floats(-1400.0, 1400.0)


def test_radii_of_curvature_of_wgs84() -> None:
    assert geodesy.meridian_radius(0.0) == pytest.approx(6335439.327, abs=1e-3)
    assert geodesy.transverse_radius(0.0) == 6378137.0
    polar = 6399593.626
    assert geodesy.meridian_radius(math.pi / 2) == pytest.approx(polar, abs=1e-3)
    assert geodesy.transverse_radius(math.pi / 2) == pytest.approx(polar, abs=1e-3)


@given(places, metres, metres, st.floats(-500.0, 100.0))
def test_there_and_back(home: Home, north: float, east: float, down: float) -> None:
    place = geodetic_from_ned(home, (north, east, down))
    assert -math.pi <= place[1] <= math.pi
    assert ned_from_geodetic(home, *place) == pytest.approx((north, east, down), abs=1e-6)


def ecef(latitude: float, longitude: float, altitude: float) -> tuple[float, float, float]:
    n = geodesy.transverse_radius(latitude)
    across = (n + altitude) * math.cos(latitude)
    polar = (n * (1.0 - geodesy.ECCENTRICITY_SQUARED) + altitude) * math.sin(latitude)
    return across * math.cos(longitude), across * math.sin(longitude), polar


@given(st.floats(0.0, math.tau), st.floats(0.0, 2000.0), places)
def test_distances_on_the_ellipsoid_agree_to_a_centimetre(bearing: float, distance: float, home: Home) -> None:
    home = home._replace(latitude=home.latitude * 0.75)  # within 60 degrees of the equator
    place = geodetic_from_ned(home, (distance * math.cos(bearing), distance * math.sin(bearing), 0.0))
    chord = math.dist(ecef(*home[:3]), ecef(*place))
    assert chord == pytest.approx(distance, abs=0.01)


def test_directions() -> None:
    latitude, longitude, altitude = geodetic_from_ned(COLLEGE_PARK, (100.0, 200.0, -30.0))
    assert latitude > COLLEGE_PARK.latitude
    assert longitude > COLLEGE_PARK.longitude
    assert altitude == COLLEGE_PARK.altitude + 30.0


@given(st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5), st.floats(0.2, 0.7))
def test_magnetic_field_has_its_angles(declination: float, dip: float, strength: float) -> None:
    north, east, down = field_ned(MagneticField(declination, dip, strength))
    assert math.hypot(north, east, down) == pytest.approx(strength)
    assert math.atan2(down, math.hypot(north, east)) == pytest.approx(dip, abs=1e-9)
    assert math.remainder(math.atan2(east, north) - declination, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_home_field_agrees_with_the_reference_field() -> None:
    declination, dip, strength = mavextra.get_mag_field_ef(
        math.degrees(COLLEGE_PARK.latitude), math.degrees(COLLEGE_PARK.longitude)
    )
    assert math.degrees(COLLEGE_PARK.magnetic.declination) == pytest.approx(declination, abs=0.5)
    assert math.degrees(COLLEGE_PARK.magnetic.dip) == pytest.approx(dip, abs=0.5)
    assert COLLEGE_PARK.magnetic.strength == pytest.approx(strength, abs=0.005)


def test_wind_blows_away_from_where_it_comes() -> None:
    assert steady_wind(3.0, 0.0) == pytest.approx((-3.0, 0.0, 0.0))
    assert steady_wind(3.0, math.radians(270.0)) == pytest.approx((0.0, 3.0, 0.0))


@pytest.mark.parametrize(("speed", "direction"), [(-1.0, 0.0), (51.0, 0.0), (math.nan, 0.0), (2.0, math.inf)])
def test_impossible_wind_is_refused(speed: float, direction: float) -> None:
    with pytest.raises(InputError, match="wind"):
        steady_wind(speed, direction)
