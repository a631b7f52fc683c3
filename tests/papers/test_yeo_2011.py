"""Yeo, Atkins and Shyy 2011: lift of a rigid flapping wing from pressures over one stroke. Nothing is fitted."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from sim_bridge.aerodynamics.strip_theory import StripParameters, section_loads, strip_parameters
from sim_bridge.vectors import Floats

DATA = Path(__file__).parent.parent / "data" / "yeo2011"
PASCALS = 248.84
"""in one inch of water"""
AREAS = {
    "blue_leading": 0.072 * 0.024,
    "blue_middle": 0.072 * 0.024,
    "blue_trailing": 0.072 * 0.024,
    "orange_leading": 0.07 * 0.02112,
    "orange_middle": 0.07 * 0.02112,
    "orange_trailing": 0.07 * 0.02112,
    "green_leading": 0.04165 * 0.015,
    "green_middle": 0.06565 * 0.015,
    "green_trailing": 0.071 * 0.015,
}
"""m^2; of the panel of the half wing that each pressure stands for"""
SEMISPAN, AIRSPEED, FREQUENCY, DENSITY = 0.213, 2.9, 3.3, 1.225
OMEGA = 2.0 * math.pi * FREQUENCY
STRIPS, STEPS, PHASES = 12, 400, 100
ALPHA_MAX = math.radians(13.0)


def read(name: str) -> Floats:
    return np.loadtxt(DATA / name, delimiter=",", encoding="utf-8-sig")


def flap(phase: Floats | float) -> Floats:
    """Flap angle in rad, its rate and acceleration; the measured motion's first three harmonics."""
    p = 2.0 * math.pi * np.asarray(phase)
    angle = 0.0354 + 0.3793 * np.sin(p) - 0.0322 * np.cos(2 * p) - 0.0035 * np.sin(3 * p)
    rate = OMEGA * (0.3793 * np.cos(p) + 0.0644 * np.sin(2 * p) - 0.0105 * np.cos(3 * p))
    acceleration = OMEGA**2 * (-0.3793 * np.sin(p) + 0.1288 * np.cos(2 * p) + 0.0315 * np.sin(3 * p))
    return np.array([angle, rate, acceleration])


def measured_lift() -> Floats:
    """N; both wings, at `PHASES` equal steps of the stroke."""
    half = sum(
        read(f"{name}_point_experimental_pressures.csv")[:, 1] * PASCALS * area for name, area in AREAS.items()
    )
    return 2.0 * np.asarray(half) * np.cos(flap(np.arange(PHASES) / PHASES)[0])


def chords() -> tuple[Floats, Floats]:
    """Middle of each strip and its mean chord, m."""
    outline = read("extracted_planform_coordinates.csv") * 1e-3
    tip = int(np.argmax(outline[:, 0]))
    fine = (np.arange(STRIPS * 100) + 0.5) / (STRIPS * 100) * SEMISPAN
    leading = np.interp(fine, *np.unique(outline[: tip + 1], axis=0).T)
    trailing = np.interp(fine, *np.unique(outline[tip:], axis=0).T)
    return fine.reshape(STRIPS, -1).mean(axis=1), (leading - trailing).reshape(STRIPS, -1).mean(axis=1)


def section(stall_angle: float) -> StripParameters:
    _, chord = chords()
    return strip_parameters(2.0 * SEMISPAN / chord.mean(), 0.0, 0.9, stall_angle)


def modelled_lift(p: StripParameters) -> Floats:
    """N; both wings in prescribed motion at `PHASES` steps of the third stroke."""
    middle, chord = chords()
    width, dt = SEMISPAN / STRIPS, 1.0 / FREQUENCY / STEPS
    lag, out, lift = np.zeros(STRIPS), np.zeros(6), np.zeros(STEPS)
    for i in range(3 * STEPS):
        angle, rate, acceleration = flap(i / STEPS).tolist()
        normal = 0.0
        for j in range(STRIPS):
            down = -rate * middle[j]
            section_loads(np.array([AIRSPEED, down, down, down, 0.0]), chord[j], DENSITY, lag[j], p, out)
            normal += (out[0] + out[1] - out[4] * acceleration * middle[j]) * width
            lag[j] += dt * out[3]
        lift[i % STEPS] = 2.0 * normal * math.cos(angle)
    return lift[:: STEPS // PHASES]


class Score(NamedTuple):
    rms: float
    """model over measurement"""
    error: float
    """N; mean absolute"""
    correlation: float


def score(p: StripParameters) -> Score:
    ours, theirs = modelled_lift(p), measured_lift()
    rms = math.sqrt(float(np.mean(ours**2) / np.mean(theirs**2)))
    return Score(rms, float(np.mean(np.abs(ours - theirs))), float(np.corrcoef(ours, theirs)[0, 1]))


def test_the_panels_cover_the_wing() -> None:
    _, chord = chords()
    assert sum(AREAS.values()) == pytest.approx(chord.mean() * SEMISPAN, rel=0.02)


def test_the_motion_is_the_measured_one() -> None:
    positions = read("measured_wing_positions.csv")
    assert flap(positions[:, 0])[0] == pytest.approx(np.radians(positions[:, 1]), abs=0.07)


def test_the_lift_of_the_stroke_has_the_measured_shape() -> None:
    assert score(section(ALPHA_MAX)).correlation > 0.98


def test_with_kims_stall_factor_lift_is_too_large() -> None:
    """The factor keeps the sections attached to twice 13 degrees: the gap as it is, not a target."""
    found = score(section(ALPHA_MAX))
    assert found.rms == pytest.approx(1.45, abs=0.08)
    assert found.error < 0.04


def test_without_kims_stall_factor_the_lift_is_the_measured_one() -> None:
    """DeLaurier's own criterion: as plunging takes the factor to its bound of 2, half the angle gives a fixed 13."""
    found = score(section(ALPHA_MAX / 2.0))
    assert found.error < 0.025
    assert found.rms == pytest.approx(1.0, abs=0.12)


@pytest.mark.xfail(strict=True, reason="Kim's factor stays on; without it 10 % remain against the pressures' own sum")
def test_rms_lift_within_five_percent() -> None:
    assert score(section(ALPHA_MAX)).rms == pytest.approx(1.0, abs=0.05)
