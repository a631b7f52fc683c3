from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.protocol import Motion, Strips, blank_loads
from sim_bridge.aerodynamics.regression import (
    COLUMNS,
    IDENTIFIED,
    MODEL,
    PARTS,
    REACH,
    Regression,
    Regressors,
    check,
    coefficients,
    dynamic_pressure,
    level_heave,
    regressors,
    wing_loads,
)
from sim_bridge.flight_mechanics.prescribed import (
    SLOW_HAWK_STROKE,
    WingMotion,
    elliptic_wing,
    protocol_motions,
    steady_flight,
    strips_of,
)
from sim_bridge.flight_mechanics.stroke_loads import prescribed_loads
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

TIME = Regression("time", 0.3, 0.25)
FREQUENCY = Regression("frequency", 0.3, 0.25)
WING = elliptic_wing(0.6, 0.318, 40, np.array([0.05, 0.02, -0.03]))
STRIPS = strips_of(WING)
FLIGHT = steady_flight(SLOW_HAWK_STROKE, 60, 9.2, 0.03)


def body_load(motion: Motion, settings: Regression = TIME, density: float = 1.225) -> Floats:
    out = blank_loads(len(PARTS), STRIPS, 0)
    MODEL.loads(MODEL.build(settings, STRIPS), STRIPS, motion, density, np.zeros(0), out)
    assert not out.parts.any() and not out.apparent.any()
    return out.body.sum(axis=0)


def swapped(motion: Motion, strips: Strips) -> Motion:
    """The motion seen in a mirror: left and right wing change places."""
    half = len(strips.chord) // 2
    turned = [np.roll(column, half) for column in motion[:5]]
    body = motion.body * (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
    return Motion(
        *turned,
        motion.place,
        motion.axes,
        motion.wings[::-1].copy(),
        body,
        motion.tail * (1.0, -1.0),
        motion.tail_rate,
        motion.ground,
    )


def lopsided() -> Motion:
    """Each wing at an instant of its own, in a turn."""
    early, late = (protocol_motions(WING, FLIGHT)[i] for i in (3, 20))
    half = len(WING.span)
    columns = [np.concatenate((a[:half], b[half:])) for a, b in zip(early[:5], late[:5], strict=True)]
    wings = np.stack((early.wings[0], late.wings[1]))
    return Motion(*columns, early.place, early.axes, wings, np.array([9.1, 0.4, 0.3, 0.2, 0.5, -0.1]), *early[9:])


@pytest.mark.parametrize("settings", [TIME, FREQUENCY])
def test_the_coefficients_are_linear_in_the_regressors_of_eq_17_to_19(settings: Regression) -> None:
    t = COLUMNS[settings.column]
    c = coefficients(t, Regressors(9.0, 0.5, -0.4, 0.3, 12.0))
    assert c.lift == pytest.approx(
        t.lift_zero + 9.0 * t.lift_forward + 0.5 * t.lift_heave - 0.4 * t.lift_pitch_rate + 12.0 * t.lift_flap_rate
    )
    assert c.thrust == pytest.approx(
        t.thrust_zero + 12.0 * t.thrust_flap_rate + 0.09 * t.thrust_flap_squared + 144.0 * t.thrust_flap_rate_squared
    )
    assert c.moment == pytest.approx(t.moment_zero - 0.4 * t.moment_pitch_rate + 12.0 * t.moment_flap_rate)


def test_the_wing_angle_counts_down() -> None:
    instant = protocol_motions(WING, FLIGHT)[3]
    r = regressors(instant)
    assert r.flap == pytest.approx(-FLIGHT.flap[3]) and r.flap_rate == pytest.approx(-FLIGHT.flap_rate[3])
    assert (r.forward, r.heave) == pytest.approx((9.2 * math.cos(0.03), 9.2 * math.sin(0.03)))


def test_the_speed_is_that_at_the_aerodynamic_centre() -> None:
    motion = steady_flight(SLOW_HAWK_STROKE, 60, 9.2)
    i = int(np.argmin(motion.flap_rate))
    centre = float(np.sum(WING.span * WING.chord * WING.width) / np.sum(WING.chord * WING.width))
    assert centre == pytest.approx(4.0 / (3.0 * math.pi) * 0.6, rel=1e-2)
    pressure = dynamic_pressure(STRIPS, protocol_motions(WING, motion)[i], 1.225)
    assert pressure == pytest.approx(0.5 * 1.225 * (9.2**2 + (centre * motion.flap_rate[i]) ** 2), rel=1e-9)


def test_loads_scale_with_density_area_and_chord() -> None:
    motion = lopsided()
    load = body_load(motion)
    assert body_load(motion, density=2.45) == pytest.approx(2.0 * load)
    assert body_load(motion, TIME._replace(area=0.6)) == pytest.approx(2.0 * load)
    assert body_load(motion, TIME._replace(chord=0.5)) == pytest.approx(load * (1.0, 1.0, 1.0, 1.0, 2.0, 1.0))


def test_the_parts_sum_to_the_load_on_the_fuselage() -> None:
    motion, out = lopsided(), blank_loads(len(PARTS), STRIPS, 0)
    out.body[:] = 1.0
    parameters = MODEL.build(FREQUENCY, STRIPS)
    MODEL.loads(parameters, STRIPS, motion, 1.225, np.zeros(0), out)
    whole = wing_loads(parameters, STRIPS, motion, 1.225)
    assert [np.flatnonzero(part).tolist() for part in out.body] == [[2], [0], [4]]
    assert out.body.sum(axis=0)[[2, 0, 4]] == pytest.approx((-whole.lift, whole.thrust, whole.moment), rel=1e-12)


def test_a_mirrored_motion_gives_the_mirrored_load() -> None:
    motion = lopsided()
    mirrored = body_load(motion) * (1.0, -1.0, 1.0, -1.0, 1.0, -1.0)
    assert body_load(swapped(motion, STRIPS)) == pytest.approx(mirrored, rel=1e-12)


def test_at_rest_there_is_no_load() -> None:
    still = FLIGHT._replace(velocity=np.zeros((60, 3)), flap_rate=np.zeros(60))
    assert not prescribed_loads(MODEL, TIME, WING, still).any()


@pytest.mark.parametrize("settings", [TIME, FREQUENCY])
@pytest.mark.parametrize("speed", [-30.0, 0.0, 1.0, 100.0])
def test_far_outside_its_range_the_coefficients_stay_those_of_the_reach(settings: Regression, speed: float) -> None:
    wild = WingMotion(
        FLIGHT.phase,
        FLIGHT.frequency,
        FLIGHT.flap,
        40.0 * FLIGHT.flap_rate,
        FLIGHT.twist,
        FLIGHT.twist_rate,
        np.tile([speed, 0.0, -speed], (60, 1)),
        np.tile([0.0, 50.0, 0.0], (60, 1)),
    )
    t = COLUMNS[settings.column]
    bound = abs(t.lift_zero + t.lift_forward * 9.2) + t.lift_forward * REACH.forward + t.lift_heave * REACH.heave
    bound += t.lift_pitch_rate * REACH.pitch_rate + t.lift_flap_rate * REACH.flap_rate
    for instant, load in zip(
        protocol_motions(WING, wild), prescribed_loads(MODEL, settings, WING, wild), strict=True
    ):
        assert np.all(np.isfinite(load))
        assert abs(load[2]) <= bound * dynamic_pressure(STRIPS, instant, 1.225) * 0.3 * (1.0 + 1e-9)


def test_the_airspeed_is_checked_and_the_limit_named() -> None:
    check(TIME, 9.2)
    for speed in IDENTIFIED:
        check(TIME, speed)
    for speed in (0.0, 8.0, 12.0, math.nan):
        with pytest.raises(InputError, match=r"^regression holds from 8\.7 to 9\.7 m/s.*not at \S+ m/s$"):
            check(TIME, speed)


def test_an_unknown_column_is_refused() -> None:
    with pytest.raises(InputError, match=r'regression\.column must be one of time, frequency, not "wavelet"'):
        MODEL.build(TIME._replace(column="wavelet"), STRIPS)


def test_the_heave_speed_for_a_lift_gives_that_lift() -> None:
    heave = level_heave(TIME, 9.0, 0.25)
    c = coefficients(COLUMNS["time"], Regressors(9.0, heave, 0.0, 0.2, 0.0))
    assert c.lift == pytest.approx(0.25, rel=1e-12)
    with pytest.raises(InputError, match="holds from"):
        level_heave(TIME, 12.0, 0.25)
