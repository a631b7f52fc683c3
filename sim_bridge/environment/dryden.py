"""Dryden gusts (MIL-F-8785C 3.7.2 to 3.7.3; Beard and McLain 2012, 4.4), stepped through the distance flown.

The field of gusts is frozen: what counts is the distance through the air between two ticks, so that the filters are
exact for any airspeed and any tick. Their states have fixed variances; scale and strength follow height. Frozen it is
only for who passes faster than it turns over (Taylor's hypothesis): who is slower than sigma_u, a launcher or a bird
that a gust holds up, meets it at that speed, for an eddy lives about as long as it takes to cross its own length.

    Phi_u(W) = sigma_u^2 2 L_u / pi / (1 + (L_u W)^2)
    Phi_v(W) = sigma_v^2 L_v / pi (1 + 3 (L_v W)^2) / (1 + (L_v W)^2)^2,  Phi_w alike
    Phi_p(W) = sigma_w^2 / L_w 0.8 (pi L_w / 4b)^(1/3) / (1 + (4b W / pi)^2)
    Phi_q(W) = W^2 / (1 + (4b W / pi)^2) Phi_w(W),  Phi_r(W) = W^2 / (1 + (3b W / pi)^2) Phi_v(W)

for W in rad/m, each from 0 to infinity; b is the span. Rotation is that of the air as of a rigid body: q = -dw/dx,
r = dv/dx. Axes: along the flight through the mean air, horizontal; across it to the right; down. The specification
turns them into body axes above 2000 ft; they are left level here, where length and intensity know no direction.

The axes turn with the flight and the air does not. Who turns, or is blown backwards by a gust as strong as his own
airspeed, as a bird may be, would see the wind jump if u and v kept their values. So u and v are taken over into the
new axes, with what the filters remember: the air's velocity stays what it was, in every direction the spectra hold.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import kernel
from sim_bridge.environment.levels import INTENSITIES, LEVELS, LEVELS_TOLD, SMALL_UAV, WIND_AT_20_FT
from sim_bridge.observation import Vector
from sim_bridge.vectors import Floats
from wingbeat.errors import InputError

FOOT = 0.3048
"""m"""
LOWEST, LOW, MEDIUM = 10.0, 1000.0, 2000.0
"""ft; the low-altitude model holds from the first to the second, that of medium and high altitude above the third"""
FREE_LENGTH = 1750.0
"""ft; scale of turbulence in the free air"""
HEIGHTS = (1750.0, 3750.0, 7500.0, 15000.0, 25000.0, 35000.0, 45000.0)
"""ft; of the columns of `INTENSITIES`"""
NARROWEST, WIDEST = 0.01, 100.0
"""m; span of a vehicle"""
DRAWS, BLOCK = 6, 256
"""numbers a tick; ticks drawn at once"""
SERIES = 0.05
"""-; step over scale below which the closed form of the noise's covariance loses digits"""
ROOT_3 = math.sqrt(3.0)

Memory = tuple[float, float, float, float, float, float, float, float, float]
"""a `GustState` without its tick, in its order"""
Noise = tuple[float, float, float, float, float, float]
"""-; `DRAWS` independent normal numbers of one tick"""
Strength = tuple[float, float, float, float, float, float, float, float, float, float, float, float]
"""m/s, ft/s, m and m/s; a level's `WIND_AT_20_FT`, its row of `INTENSITIES`, its row of `SMALL_UAV` (else zeros)"""
FIXED = 1 + len(HEIGHTS)
"""-; where in a `Strength` the row of `SMALL_UAV` begins"""


class Turbulence(NamedTuple):
    """Turbulence of one flight."""

    level: str
    """one of `levels.LEVELS`"""
    span: float
    """m; of the vehicle"""
    seed: int


class GustState(NamedTuple):
    """States of the shaping filters; unit variance unless noted."""

    tick: int
    """-; steps made; selects the noise"""
    along: float
    across: float
    """-; first-order stage of the gust across, variance 1/2"""
    across_slow: float
    """-; second-order stage, variance 1/4"""
    down: float
    """-; as ``across``"""
    down_slow: float
    """-; as ``across_slow``"""
    roll: float
    pitch_lag: float
    """-; gust down as the span smooths it"""
    yaw_lag: float
    """-; gust across as the span smooths it"""
    heading: float
    """rad; of the axes, clockwise from north"""


class Gust(NamedTuple):
    """Gust velocity in addition to the mean wind; NED."""

    velocity: Vector
    """m/s"""
    omega: Vector
    """rad/s; angular velocity of the air, NED axes"""


class Scale(NamedTuple):
    """Length scales and intensities at one height."""

    level_length: float
    """m; L_u, L_v"""
    down_length: float
    """m; L_w"""
    level_intensity: float
    """m/s; sigma_u, sigma_v"""
    down_intensity: float
    """m/s; sigma_w"""


def turbulence(level: str, span: float, seed: int) -> Turbulence:
    """Gusts of a ``level`` for a vehicle of ``span`` in m; the same ``seed`` gives the same gusts.

    Raises:
        InputError: level unknown, span outside 0.01 to 100 m, seed negative.
    """
    if level not in LEVELS:
        raise InputError(f'turbulence "{level}" is unknown; it is {LEVELS_TOLD}')
    if not NARROWEST <= span <= WIDEST:
        raise InputError(f"span {span:g} m is outside {NARROWEST:g} to {WIDEST:g} m")
    if seed < 0:
        raise InputError(f"seed {seed} of the turbulence is negative")
    return Turbulence(level, span, seed)


def scale(level: str, height: float) -> Scale:
    """Scales and intensities of a ``level`` at ``height`` in m above ground.

    MIL-F-8785C 3.7.2.1, 3.7.3.4; linear in between. The levels of small unmanned aircraft (Beard and McLain 2012,
    Table 4.1, low altitude) know no height; only what moves up and down ends at the ground, as with the others.
    """
    return _scale(strength_of(level), height)


@lru_cache
def strength_of(level: str) -> Strength:
    """Return the rows of the tables of levels."""
    if level in SMALL_UAV:
        return (0.0, *INTENSITIES["none"], *SMALL_UAV[level])
    return (WIND_AT_20_FT[level], *INTENSITIES[level], 0.0, 0.0, 0.0, 0.0)


@kernel
def _scale(strength: Strength, height: float) -> Scale:
    # Below the model's lowest height the ground stops what moves up and down, as it stops the wind through it.
    near = min(max(height / FOOT / LOWEST, 0.0), 1.0)
    if strength[FIXED] > 0.0:
        return Scale(strength[FIXED], strength[FIXED + 1], strength[FIXED + 2], strength[FIXED + 3] * near)
    feet, down = max(height / FOOT, LOWEST), 0.1 * strength[0] * near
    if feet <= LOW:
        shape = 0.177 + 0.000823 * feet
        return Scale(feet / shape**1.2 * FOOT, feet * FOOT, 0.1 * strength[0] / shape**0.4, down)
    # At 1000 ft the low-altitude model knows no direction any more: one length, one intensity.
    share = min((feet - LOW) / (MEDIUM - LOW), 1.0)
    intensity = (1.0 - share) * down + share * _free_intensity(strength, max(feet, MEDIUM))
    length = ((1.0 - share) * LOW + share * FREE_LENGTH) * FOOT
    return Scale(length, length, intensity, intensity)


@kernel
def _free_intensity(strength: Strength, feet: float) -> float:
    """m/s; read from the level's row, which begins after the wind."""
    for i in range(len(HEIGHTS) - 1):
        if feet <= HEIGHTS[i + 1]:
            share = (feet - HEIGHTS[i]) / (HEIGHTS[i + 1] - HEIGHTS[i])
            return FOOT * ((1.0 - share) * strength[i + 1] + share * strength[i + 2])
    return FOOT * strength[FIXED - 1]


@lru_cache(maxsize=8)
def noise_block(seed: int, index: int) -> Floats:
    """(`BLOCK`, `DRAWS`); normal numbers of the ticks from ``index * BLOCK`` on.

    A counter replaces the memory of a generator: the noise of a tick does not depend on the ticks before.
    """
    generator = np.random.Generator(np.random.Philox(key=seed, counter=index << 64))
    return generator.standard_normal((BLOCK, DRAWS))


def _noise(seed: int, tick: int) -> Noise:
    a, b, c, d, e, f = noise_block(seed, tick // BLOCK)[tick % BLOCK].tolist()
    return a, b, c, d, e, f


def initial(t: Turbulence, heading: float = 0.0) -> GustState:
    """Draw the initial state from the stationary distribution, so that intensities hold from the start.

    ``heading`` in rad is the direction that the vehicle faces.
    """
    n = _noise(t.seed, 0)
    across, across_slow = _stationary(n[1], n[2])
    down, down_slow = _stationary(n[3], n[4])
    return GustState(
        0,
        n[0],
        across,
        across_slow,
        down,
        down_slow,
        n[5],
        _second_order(down, down_slow),
        _second_order(across, across_slow),
        heading,
    )


def _stationary(first: float, second: float) -> tuple[float, float]:
    return math.sqrt(0.5) * first, math.sqrt(0.125) * (first + second)


@kernel
def _second_order(fast: float, slow: float) -> float:
    """(1 + sqrt(3) L s) / (1 + L s)^2 of white noise, from the states after one and after two lags."""
    return ROOT_3 * fast + (1.0 - ROOT_3) * slow


@kernel
def _walk(fast: float, slow: float, step: float, first: float, second: float) -> tuple[float, float]:
    """Both lags after a ``step`` in scales: exact, with two independent normal numbers."""
    if step <= 0.0:
        return fast, slow
    keep = math.exp(-step)
    covariance, variance = lag_covariance(step, keep * keep)
    strength = math.sqrt(-0.5 * math.expm1(-2.0 * step))
    shared = covariance / strength
    rest = math.sqrt(max(variance - shared * shared, 0.0))
    return keep * fast + strength * first, keep * (slow + step * fast) + shared * first + rest * second


@kernel
def lag_covariance(step: float, square: float) -> tuple[float, float]:
    """Integrals over a step x of x exp(-2x) and of x^2 exp(-2x)."""
    if step >= SERIES:
        single = 0.25 - square * (0.5 * step + 0.25)
        return single, single - 0.5 * square * step * step
    a, x = step * step, -2.0 * step
    single = a * (1 / 2 + x * (1 / 3 + x * (1 / 8 + x * (1 / 30 + x * (1 / 144 + x / 840)))))
    return single, a * step * (1 / 3 + x * (1 / 4 + x * (1 / 10 + x * (1 / 36 + x * (1 / 168 + x / 960)))))


@kernel
def _smoothed(lag: float, before: float, after: float, step: float) -> float:
    """First-order lag after a ``step`` in its own lengths, its input going straight from one value to the other."""
    if step <= 0.0:
        return lag
    slope = (after - before) * -math.expm1(-step) / step
    return after - slope + (lag - before) * math.exp(-step)


@kernel
def pitch_length(span: float) -> float:
    """Length in m over which a vehicle of ``span`` m averages gusts in roll and pitch."""
    return 4.0 * span / math.pi


@kernel
def yaw_length(span: float) -> float:
    """Length in m over which it averages gusts in yaw."""
    return 3.0 * span / math.pi


@kernel
def roll_intensity(size: Scale, span: float) -> float:
    """Roll rate intensity sigma_p in rad/s: the square root of the integral of Phi_p."""
    length = pitch_length(span)
    share = 0.4 * math.pi * (size.down_length / length) ** (1.0 / 3.0)
    return size.down_intensity * math.sqrt(share / (length * size.down_length))


@kernel
def _turned(m: Memory, north: float, east: float) -> Memory:
    """The same air in the axes of a flight whose level part is ``north`` and ``east`` in m/s; in the old without one.

    The two stages of the gust across are correlated normal numbers: what they hold beside their sum, the gust itself,
    is independent of it and stays. Then all remain as they are distributed, for u and v are alike.
    """
    if north == 0.0 and east == 0.0:
        return m
    along, across, across_slow, down, down_slow, roll, pitch_lag, yaw_lag, before = m
    heading = math.atan2(east, north)
    cosine, sine = math.cos(heading - before), math.sin(heading - before)
    v = _second_order(across, across_slow)
    more = cosine * v - sine * along - v
    return (
        cosine * along + sine * v,
        across + 0.25 * (1.0 + ROOT_3) * more,
        across_slow + 0.25 * more,
        down,
        down_slow,
        roll,
        pitch_lag,
        yaw_lag + more,
        heading,
    )


@kernel
def _filtered(m: Memory, noise: Noise, size: Scale, span: float, way: float) -> Memory:
    """The filters after a ``way`` in m through the frozen field; ``noise`` are `DRAWS` numbers."""
    along, across, across_slow, down, down_slow, roll, pitch_lag, yaw_lag, heading = m
    keep, calm = math.exp(-way / size.level_length), math.exp(-way / pitch_length(span))
    new_across = _walk(across, across_slow, way / size.level_length, noise[1], noise[2])
    new_down = _walk(down, down_slow, way / size.down_length, noise[3], noise[4])
    v_before, v_after = _second_order(across, across_slow), _second_order(new_across[0], new_across[1])
    w_before, w_after = _second_order(down, down_slow), _second_order(new_down[0], new_down[1])
    return (
        keep * along + math.sqrt(1.0 - keep * keep) * noise[0],
        new_across[0],
        new_across[1],
        new_down[0],
        new_down[1],
        calm * roll + math.sqrt(1.0 - calm * calm) * noise[5],
        _smoothed(pitch_lag, w_before, w_after, way / pitch_length(span)),
        _smoothed(yaw_lag, v_before, v_after, way / yaw_length(span)),
        heading,
    )


@kernel
def _gust(m: Memory, size: Scale, span: float) -> tuple[Vector, Vector]:
    """Velocity in m/s and angular velocity in rad/s of the air, NED."""
    along, across, across_slow, down, down_slow, roll, pitch_lag, yaw_lag, heading = m
    cosine, sine = math.cos(heading), math.sin(heading)
    v, w = _second_order(across, across_slow), _second_order(down, down_slow)
    u, p = size.level_intensity * along, roll_intensity(size, span) * roll
    q = -size.down_intensity * (w - pitch_lag) / pitch_length(span)
    r = size.level_intensity * (v - yaw_lag) / yaw_length(span)
    v *= size.level_intensity
    return (
        (cosine * u - sine * v, sine * u + cosine * v, size.down_intensity * w),
        (cosine * p - sine * q, sine * p + cosine * q, r),
    )


@kernel
def advance(
    m: Memory, noise: Noise, strength: Strength, place: tuple[float, float], flight: Vector, dt: float
) -> tuple[Memory, Vector, Vector]:
    """Return filters, velocity (m/s) and angular velocity (rad/s) of the next tick; ``place``: span, height in m."""
    span, height = place
    size = _scale(strength, height)
    airspeed = math.sqrt(flight[0] * flight[0] + flight[1] * flight[1] + flight[2] * flight[2])
    turned = _turned(m, flight[0], flight[1])
    after = _filtered(turned, noise, size, span, max(airspeed, size.level_intensity) * dt)
    velocity, omega = _gust(after, size, span)
    return after, velocity, omega


def step(t: Turbulence, state: GustState, height: float, flight: Vector, dt: float) -> tuple[GustState, Gust]:
    """Return state and gust after ``dt`` s of flight at ``height`` m above ground.

    ``flight`` is the velocity in m/s, NED, through the mean air; while it has no level part, the axes stay.
    """
    tick = state.tick + 1
    noise = _noise(t.seed, tick)
    after, velocity, omega = advance(state[1:], noise, strength_of(t.level), (t.span, height), flight, dt)
    return GustState._make((tick, *after)), Gust(velocity, omega)
