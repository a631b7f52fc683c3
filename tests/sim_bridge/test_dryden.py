"""Gusts against the spectra, scales and intensities that MIL-F-8785C and Beard and McLain print."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from sim_bridge.environment.dryden import (
    FOOT,
    SERIES,
    Gust,
    GustState,
    Scale,
    Turbulence,
    initial,
    lag_covariance,
    pitch_length,
    roll_intensity,
    scale,
    step,
    turbulence,
    yaw_length,
)
from sim_bridge.environment.levels import KNOT, SMALL_UAV, WIND_AT_20_FT
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

SPEED, HEIGHT, SPAN, DT = 8.0, 30.0, 1.2, 0.02
NORTH = (SPEED, 0.0, 0.0)
EVERY_LEVEL = "none, light, moderate, severe, small_uav_light or small_uav_moderate"
COMPONENTS = ("u", "v", "w", "p", "q", "r")


def simulate(
    t: Turbulence, steps: int, dt: float = DT, flight: tuple[float, float, float] = NORTH, heading: float = 0.0
) -> Floats:
    """Gusts (steps, 6): velocity and angular velocity, NED."""
    state, out = initial(t, heading), np.zeros((steps, 6))
    for i in range(steps):
        state, gust = step(t, state, HEIGHT, flight, dt)
        out[i, :3], out[i, 3:] = gust.velocity, gust.omega
    return out


@cache
def long_flight() -> Floats:
    return simulate(turbulence("moderate", SPAN, 5), 2**19)


def printed(component: str, wave: Floats, size: Scale) -> Floats:
    """The specification's one-sided spectra over wave numbers in rad/m."""
    level, down, half = size.level_intensity, size.down_intensity, math.pi / 4.0 / SPAN
    if component == "u":
        return level**2 * 2 * size.level_length / math.pi / (1 + (size.level_length * wave) ** 2)
    if component == "p":
        bracket = 0.8 * (half * size.down_length) ** (1 / 3) / (1 + (wave / half) ** 2)
        return np.asarray(down**2 / size.down_length * bracket)
    if component == "q":
        return np.asarray(wave**2 / (1 + (4 * SPAN * wave / math.pi) ** 2) * printed("w", wave, size))
    if component == "r":
        return np.asarray(wave**2 / (1 + (3 * SPAN * wave / math.pi) ** 2) * printed("v", wave, size))
    length, strength = (size.level_length, level) if component == "v" else (size.down_length, down)
    square = (length * wave) ** 2
    return np.asarray(strength**2 * length / math.pi * (1 + 3 * square) / (1 + square) ** 2)


@pytest.mark.parametrize(
    "component", [pytest.param(each, marks=pytest.mark.validate) if each == "u" else each for each in COMPONENTS]
)
def test_the_spectrum_is_the_printed_one(component: str) -> None:
    frequency, found = welch(long_flight()[:, COMPONENTS.index(component)], 1.0 / DT, nperseg=2**14)
    wave = 2.0 * math.pi * frequency / SPEED
    wanted = printed(component, wave, scale("moderate", HEIGHT)) * 2.0 * math.pi / SPEED
    bands = np.geomspace(0.01, 5.0, 9)
    for low, high in pairwise(bands):
        band = (frequency >= low) & (frequency < high)
        assert float(np.mean(found[band] / wanted[band])) == pytest.approx(1.0, abs=0.2)


def test_velocities_and_roll_blow_on_their_own_while_pitch_and_yaw_belong_to_theirs() -> None:
    cross = np.corrcoef(long_flight().T)
    assert cross[:4, :4] == pytest.approx(np.eye(4), abs=0.12)
    assert cross[2, 4] < -0.2
    assert cross[1, 5] > 0.08


@pytest.mark.parametrize("dt", [0.005, 0.5, 30.0])
def test_gusts_have_their_strength_from_the_first_tick_at_any_tick_length(dt: float) -> None:
    size = scale("severe", HEIGHT)
    wanted = (size.level_intensity, size.level_intensity, size.down_intensity, roll_intensity(size, SPAN))
    seen = np.array([simulate(turbulence("severe", SPAN, seed), 3, dt)[-1, :4] for seed in range(3000)])
    assert seen.std(axis=0) == pytest.approx(wanted, rel=0.05)
    assert np.abs(seen.mean(axis=0)) == pytest.approx(np.zeros(4), abs=0.08 * max(wanted))


@pytest.mark.parametrize("level", SMALL_UAV)
def test_gusts_of_small_aircraft_have_the_printed_strength_and_scale(level: str) -> None:
    """Over many seeds: standard deviations, and the correlation that the spectra give over 50 m flown."""
    far, level_length, down_length, level_intensity, down_intensity = 50.0, *SMALL_UAV[level]
    seen = np.array([simulate(turbulence(level, SPAN, seed), 2, far / SPEED)[:, :3] for seed in range(4000)])
    wanted = (level_intensity, level_intensity, down_intensity)
    assert seen.std(axis=(0, 1)) == pytest.approx(wanted, rel=0.04)
    kept = (seen[:, 0] * seen[:, 1]).mean(axis=0) / np.square(wanted)
    along, across, down = far / level_length, far / level_length, far / down_length
    printed_kept = (math.exp(-along), math.exp(-across) * (1 - across / 2), math.exp(-down) * (1 - down / 2))
    assert kept == pytest.approx(printed_kept, abs=0.05)


@pytest.mark.parametrize("size", [1e-5, 0.01, 0.999 * SERIES, 1.001 * SERIES, 1.0, 20.0])
def test_the_covariance_of_two_lags_is_its_integral(size: float) -> None:
    first = quad(lambda x: x * math.exp(-2 * x), 0.0, size, epsabs=0.0, epsrel=1e-11)[0]
    second = quad(lambda x: x * x * math.exp(-2 * x), 0.0, size, epsabs=0.0, epsrel=1e-11)[0]
    assert lag_covariance(size, math.exp(-2 * size)) == pytest.approx((first, second), rel=1e-9)


def test_pitch_and_yaw_are_the_gradients_of_the_smoothed_gusts() -> None:
    """Over the way they add up to the change of what the span smooths; nose up in an updraught that grows ahead."""
    t = turbulence("light", SPAN, 2)
    size, state, rates = scale("light", HEIGHT), initial(t), []
    states = [state]
    for _ in range(2000):
        state, gust = step(t, state, HEIGHT, NORTH, 0.001)
        states.append(state)
        rates.append(gust.omega)
    way, rate = 0.001 * SPEED, np.array(rates)
    turned = (0.5 * (rate[1:] + rate[:-1])).sum(axis=0) * way
    pitch, yaw = states[-1].pitch_lag - states[1].pitch_lag, states[-1].yaw_lag - states[1].yaw_lag
    assert turned[1] == pytest.approx(-size.down_intensity * pitch, rel=1e-3)
    assert turned[2] == pytest.approx(size.level_intensity * yaw, rel=1e-3)


def test_the_axes_are_those_of_the_flight() -> None:
    t = turbulence("light", SPAN, 9)
    north, east = simulate(t, 50), simulate(t, 50, flight=(0.0, SPEED, 0.0), heading=0.5 * math.pi)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert east[:, :3] == pytest.approx(north[:, :3] @ quarter.T, abs=1e-12)
    assert east[:, 3:] == pytest.approx(north[:, 3:] @ quarter.T, abs=1e-12)


@pytest.mark.parametrize("turn", [0.3, 0.5 * math.pi, math.pi, -2.0])
def test_the_wind_does_not_jump_when_the_flight_turns(turn: float) -> None:
    """Not even when a gust blows the vehicle backwards through the mean air: GIVEN no way between two ticks."""
    t = turbulence("moderate", SPAN, 11)
    state, before = step(t, initial(t), HEIGHT, NORTH, DT)
    _, after = step(t, state, HEIGHT, (SPEED * math.cos(turn), SPEED * math.sin(turn), 0.0), 1e-9)
    assert math.hypot(*before.velocity) > 1.0
    assert after.velocity == pytest.approx(before.velocity, abs=1e-3)
    assert after.omega[2] == pytest.approx(before.omega[2], abs=1e-3)


def test_gusts_keep_strength_and_scale_through_turns() -> None:
    """Over many seeds, the last 40 m flown straight after two turns: as in the specification on a straight flight."""
    size, way, seen, axes = scale("moderate", HEIGHT), 40.0, [], []
    for seed in range(4000):
        t = turbulence("moderate", SPAN, seed)
        state, _ = step(t, initial(t), HEIGHT, (0.0, SPEED, 0.0), 3.0)
        turned, one = step(t, state, HEIGHT, (-SPEED, 0.0, 0.0), 1e-6)
        _, other = step(t, turned, HEIGHT, (-SPEED, 0.0, 0.0), way / SPEED)
        seen.append((one.velocity[:2], other.velocity[:2]))
        axes.append((turned.across, turned.across_slow))
    velocity, share = np.array(seen), way / size.level_length
    assert velocity.std(axis=0) == pytest.approx(size.level_intensity * np.ones((2, 2)), rel=0.04)
    kept = (velocity[:, 0] * velocity[:, 1]).mean(axis=0) / size.level_intensity**2
    assert kept == pytest.approx((math.exp(-share), math.exp(-share) * (1 - share / 2)), abs=0.05)
    assert np.cov(np.transpose(axes)) == pytest.approx(np.array([[0.5, 0.25], [0.25, 0.25]]), rel=0.08)


@pytest.mark.parametrize("speed", [0.0, 0.5])
def test_who_hardly_moves_through_the_air_meets_the_gusts_turn_over_at_their_own_speed(speed: float) -> None:
    """In a field that stands still a bird could ride on one gust for ever, and a launcher never see a lull end."""
    t = turbulence("severe", SPAN, 1)
    own = scale("severe", HEIGHT).level_intensity
    slow, _ = step(t, initial(t), HEIGHT, (speed, 0.0, 0.0), DT)
    through, _ = step(t, initial(t), HEIGHT, (own, 0.0, 0.0), DT)
    faster, _ = step(t, initial(t), HEIGHT, (1.1 * own, 0.0, 0.0), DT)
    assert slow == through != faster


def test_still_air_stays_still() -> None:
    t = turbulence("none", SPAN, 1)
    state = initial(t)
    after, gust = step(t, state, HEIGHT, (0.0, 0.0, 0.0), DT)
    assert after == state._replace(tick=1)
    assert gust == Gust((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def test_a_climb_straight_up_crosses_the_field_too() -> None:
    t = turbulence("severe", SPAN, 1)
    after, _ = step(t, initial(t), HEIGHT, (0.0, 0.0, -SPEED), DT)
    level, _ = step(t, initial(t), HEIGHT, NORTH, DT)
    assert after == level


def test_the_same_seed_gives_the_same_gusts_and_another_gives_others() -> None:
    assert np.array_equal(simulate(turbulence("light", SPAN, 4), 600), simulate(turbulence("light", SPAN, 4), 600))
    assert not np.allclose(simulate(turbulence("light", SPAN, 4), 5), simulate(turbulence("light", SPAN, 5), 5))


def test_a_kept_state_goes_on_as_if_nothing_had_happened() -> None:
    """Whatever other gusts were asked for in between: the noise belongs to seed and tick alone."""
    t = turbulence("light", SPAN, 4)
    whole, state = simulate(t, 700), initial(t)
    for _ in range(500):
        state, _ = step(t, state, HEIGHT, NORTH, DT)
    kept = GustState(*tuple(state))
    for seed in range(20):
        simulate(turbulence("severe", SPAN, 100 + seed), 10)
    rest: list[Gust] = []
    for _ in range(200):
        kept, gust = step(t, kept, HEIGHT, NORTH, DT)
        rest.append(gust)
    assert np.array_equal(np.array([[*g.velocity, *g.omega] for g in rest]), whole[500:])


def test_without_turbulence_the_air_is_still() -> None:
    assert not simulate(turbulence("none", SPAN, 0), 20).any()


@pytest.mark.parametrize(("level", "knots"), [("light", 15.0), ("moderate", 30.0), ("severe", 45.0)])
def test_near_the_ground_the_vertical_gust_is_a_tenth_of_the_wind_at_twenty_feet(level: str, knots: float) -> None:
    for feet in (20.0, 100.0, 999.0):
        size = scale(level, feet * FOOT)
        assert size.down_intensity == pytest.approx(0.1 * knots * KNOT)
        assert size.down_length == pytest.approx(feet * FOOT)
        ratio = size.level_intensity / size.down_intensity
        assert ratio == pytest.approx((0.177 + 0.000823 * feet) ** -0.4)
        assert size.level_length / size.down_length == pytest.approx(ratio**3.0)


def test_where_the_low_model_ends_it_knows_no_direction() -> None:
    size = scale("light", 1000.0 * FOOT)
    assert size.level_length == pytest.approx(size.down_length)
    assert size.level_intensity == pytest.approx(size.down_intensity)


@pytest.mark.parametrize("feet", [1000.0, 2000.0, 3750.0])
def test_nothing_jumps_where_one_model_ends(feet: float) -> None:
    below, above = scale("moderate", (feet - 1e-6) * FOOT), scale("moderate", (feet + 1e-6) * FOOT)
    assert below == pytest.approx(above, rel=1e-6)


@pytest.mark.parametrize(("level", "speed"), [("light", 7.4), ("moderate", 10.6), ("severe", 23.0)])
def test_in_the_free_air_length_is_fixed_and_strength_read_from_the_figure(level: str, speed: float) -> None:
    wanted = (1750.0 * FOOT, 1750.0 * FOOT, speed * FOOT, speed * FOOT)
    assert scale(level, 3750.0 * FOOT) == pytest.approx(wanted)


def test_below_ten_feet_the_ground_stops_what_moves_up_and_down_alone() -> None:
    lowest, half, ground = (scale("light", feet * FOOT) for feet in (10.0, 5.0, 0.0))
    assert half == lowest._replace(down_intensity=pytest.approx(0.5 * lowest.down_intensity))
    assert ground == lowest._replace(down_intensity=0.0)
    assert roll_intensity(ground, SPAN) == 0.0


@pytest.mark.parametrize("level", SMALL_UAV)
def test_gusts_of_small_aircraft_know_no_height_but_the_ground(level: str) -> None:
    printed_row = Scale(*SMALL_UAV[level])
    assert {scale(level, height) for height in (3.1, 50.0, 300.0, 2000.0)} == {printed_row}
    half, ground = scale(level, 5.0 * FOOT), scale(level, 0.0)
    assert half == printed_row._replace(down_intensity=pytest.approx(0.5 * printed_row.down_intensity))
    assert ground == printed_row._replace(down_intensity=0.0)


def test_above_the_figure_its_last_value_holds() -> None:
    assert scale("severe", 60000.0 * FOOT) == scale("severe", 45000.0 * FOOT)


def test_a_wider_vehicle_is_rolled_less() -> None:
    size = scale("light", HEIGHT)
    assert roll_intensity(size, 2.0 * SPAN) < roll_intensity(size, SPAN)
    assert pitch_length(SPAN) == pytest.approx(4.0 / 3.0 * yaw_length(SPAN))


@pytest.mark.parametrize(
    ("level", "span", "seed", "stated"),
    [
        ("storm", 1.0, 0, f'turbulence "storm" is unknown; it is {EVERY_LEVEL}'),
        ("light", 0.0, 0, "span 0 m is outside 0.01 to 100 m"),
        ("light", math.nan, 0, "span nan m is outside 0.01 to 100 m"),
        ("light", 1.0, -1, "seed -1 of the turbulence is negative"),
    ],
)
def test_bad_input_is_told_in_one_line(level: str, span: float, seed: int, stated: str) -> None:
    with pytest.raises(InputError) as caught:
        turbulence(level, span, seed)
    assert str(caught.value) == stated


def test_the_levels_are_the_specifications() -> None:
    assert [round(wind / KNOT) for wind in WIND_AT_20_FT.values()] == [0, 15, 30, 45]
    assert SMALL_UAV["small_uav_light"] == (200.0, 50.0, 1.06, 0.7)
    assert SMALL_UAV["small_uav_moderate"] == (200.0, 50.0, 2.12, 1.4)
