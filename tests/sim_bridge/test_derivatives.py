"""The loads of a flight test: linear about the trim, of mass and inertia, and finite anywhere."""

from __future__ import annotations

import math

import numpy as np
import pytest
from aerodynamics_bench import IDENTIFIED

from sim_bridge.aerodynamics.derivatives import DRIVE, MODEL, RATE_REACH, REACH, Derivatives, build, check
from sim_bridge.aerodynamics.protocol import Motion, Strips, blank_loads, blank_motion
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

STRIPS = Strips(*(np.array([0.1, 0.1]) for _ in range(4)), np.array([0.0, 1.0]))
TRIM = (IDENTIFIED.forward, 0.0, IDENTIFIED.down, 0.0, 0.0, 0.0)
AIRSPEED = math.hypot(IDENTIFIED.forward, IDENTIFIED.down)
STEADY = np.array([IDENTIFIED.flap_rate**2])


def moved(
    about_centre: tuple[float, ...],
    elevator: float = IDENTIFIED.elevator,
    rudder: float = 0.0,
    flap_rate: float = 0.0,
) -> Motion:
    """A motion of the centre of mass; the body's is told at the base's origin."""
    motion = blank_motion(STRIPS, 2)
    motion.body[3:] = about_centre[3:]
    motion.body[:3] = np.array(about_centre[:3]) - np.cross(motion.body[3:], IDENTIFIED.center)
    motion.tail[:] = elevator, rudder
    motion.wings[:, 1] = flap_rate
    return motion


def borne(motion: Motion, density: float = IDENTIFIED.density, settings: Derivatives = IDENTIFIED) -> Floats:
    """Accelerations (6,) of the whole: force over mass, and moment about the centre of mass through the inertia."""
    out = blank_loads(len(MODEL.parts), STRIPS, 1)
    MODEL.loads(build(settings, STRIPS), STRIPS, motion, density, STEADY, out)
    assert not out.parts.any() and not out.apparent.any()
    load = out.body.sum(axis=0)
    xx, yy, zz, xz = settings.inertia
    inertia = np.array([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
    about = load[3:] - np.cross(settings.center, load[:3])
    return np.concatenate((load[:3] / settings.mass, np.linalg.solve(inertia, about)))


def test_in_the_trim_the_air_carries_the_aircraft_and_turns_it_nowhere() -> None:
    assert borne(moved(TRIM)) == pytest.approx(
        [IDENTIFIED.force_x, 0.0, IDENTIFIED.force_z, 0.0, 0.0, 0.0], abs=1e-12
    )


@pytest.mark.parametrize(
    ("place", "change", "suffix", "axes"),
    [
        (0, 0.3, "u", "xzm"), (2, -0.2, "w", "xzm"), (4, 0.5, "q", "xzm"),
        (1, 0.4, "v", "yln"), (3, -0.7, "p", "yln"), (5, 0.2, "r", "yln"),
    ],
)  # fmt: skip
def test_a_change_of_the_motion_has_its_derivatives_and_no_others(
    place: int, change: float, suffix: str, axes: str
) -> None:
    body = list(TRIM)
    body[place] += change
    answer = borne(moved(tuple(body))) - borne(moved(TRIM))
    # Whatever moves it sideways alters the airspeed at the centre, but inside the reach that scales nothing.
    expected = np.zeros(6)
    for axis in axes:
        expected["xyzlmn".index(axis)] = getattr(IDENTIFIED, f"{axis}_{suffix}") * change
    assert answer == pytest.approx(expected, abs=1e-12)


def test_elevator_and_rudder_have_theirs() -> None:
    still = borne(moved(TRIM))
    along = borne(moved(TRIM, elevator=IDENTIFIED.elevator + 0.1)) - still
    across = borne(moved(TRIM, rudder=-0.2)) - still
    assert along == pytest.approx(
        0.1 * np.array([IDENTIFIED.x_delta, 0, IDENTIFIED.z_delta, 0, IDENTIFIED.m_delta, 0])
    )
    expected = (0, IDENTIFIED.y_rudder, 0, IDENTIFIED.l_rudder, 0, IDENTIFIED.n_rudder)
    assert across == pytest.approx(-0.2 * np.array(expected), abs=1e-12)


def test_faster_flapping_drives_by_its_relative_change_behind_a_lag() -> None:
    out = blank_loads(len(MODEL.parts), STRIPS, 1)
    parameters = build(IDENTIFIED, STRIPS)
    faster = np.array([(1.3 * IDENTIFIED.flap_rate) ** 2])
    MODEL.loads(parameters, STRIPS, moved(TRIM, flap_rate=7.0), IDENTIFIED.density, faster, out)
    assert out.body[DRIVE, :3] == pytest.approx(
        0.3 * IDENTIFIED.mass * np.array([IDENTIFIED.x_drive, 0.0, IDENTIFIED.z_drive])
    )
    assert out.rates[0] == pytest.approx((49.0 - faster[0]) / IDENTIFIED.drive_lag)


def test_beyond_the_reach_the_loads_follow_the_dynamic_pressure() -> None:
    """Twice as fast, beyond it: four times the loads of the end of the line; at a crawl next to nothing."""
    angle = math.atan2(IDENTIFIED.down, IDENTIFIED.forward)
    edge, beyond, crawl = (
        borne(moved((v * math.cos(angle), 0.0, v * math.sin(angle), 0.0, 0.0, 0.0)))
        for v in (6.0 * AIRSPEED, 12.0 * AIRSPEED, 0.01 * AIRSPEED)
    )
    assert beyond == pytest.approx(4.0 * edge)
    assert np.max(np.abs(crawl)) < 0.01
    line = borne(moved((IDENTIFIED.forward + REACH * AIRSPEED - 0.3, *TRIM[1:])))
    assert line[2] == pytest.approx(IDENTIFIED.force_z + IDENTIFIED.z_u * (REACH * AIRSPEED - 0.3))


def test_a_spin_has_no_more_than_the_rates_reach() -> None:
    spinning, held = (borne(moved((*TRIM[:3], 0.0, rate, 0.0))) for rate in (3.0 * RATE_REACH, RATE_REACH))
    assert spinning == pytest.approx(held)


def test_thinner_air_carries_less() -> None:
    assert borne(moved(TRIM), 0.5 * IDENTIFIED.density) == pytest.approx(0.5 * borne(moved(TRIM)))


@pytest.mark.parametrize("inertia", [(0.0, 1.0, 1.0, 0.0), (1.0, 1.0, 1.0, 1.1)])
def test_an_inertia_that_no_body_has_is_refused(inertia: tuple[float, float, float, float]) -> None:
    with pytest.raises(InputError, match=r"^derivatives.inertia is of no body: xx, yy, zz must be above 0"):
        build(IDENTIFIED._replace(inertia=inertia), STRIPS)


def test_a_trim_far_from_the_flight_tests_airspeed_is_refused() -> None:
    check(IDENTIFIED, 1.29 * AIRSPEED)
    with pytest.raises(
        InputError, match=r"^derivatives hold within 30 % of 6.73 m/s, the airspeed they were identified"
    ):
        check(IDENTIFIED, 0.5 * AIRSPEED)
