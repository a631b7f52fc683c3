from __future__ import annotations

import builtins
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim_bridge.flight_mechanics.prescribed import (
    LEFT,
    RIGHT,
    SLOW_HAWK_STROKE,
    Stroke,
    WingMotion,
    elliptic_wing,
    flap_angles,
    protocol_motions,
    section_velocity,
    steady_flight,
    strips_of,
)
from sim_bridge.flight_mechanics.spatial import draw_spatial, spatial_kinematics
from wingbeat.errors import InputError

WING = elliptic_wing(0.5, 0.25, 10, np.array([0.06, 0.02, -0.04]))
STROKE = Stroke(5.0, 0.7, -0.5, 0.2, 0.8)


def twisting(instants: int) -> WingMotion:
    """A stroke with twist, of a fuselage that stands still."""
    motion = steady_flight(STROKE, instants, 0.0)
    angle, rate = 2.0 * np.pi * motion.phase, 2.0 * np.pi * STROKE.frequency
    return motion._replace(twist=0.3 * np.sin(angle), twist_rate=0.3 * rate * np.cos(angle))


def test_the_stroke_runs_between_its_extremes_and_comes_back() -> None:
    flap, _ = flap_angles(STROKE, np.array([0.2, 0.5, 0.8, 1.2]))
    assert flap == pytest.approx([0.7, 0.1, -0.5, 0.7])


def test_the_flap_rate_is_the_derivative_of_the_angle() -> None:
    phase = np.linspace(0.0, 1.0, 50)
    later, earlier = (flap_angles(STROKE, phase + shift)[0] for shift in (1e-6, -1e-6))
    assert flap_angles(STROKE, phase)[1] == pytest.approx((later - earlier) / 2e-6 * 5.0, abs=1e-3)


def test_a_down_stroke_that_is_no_part_of_a_stroke_is_refused() -> None:
    with pytest.raises(InputError, match=r"from phase 0\.8 to 0\.2"):
        flap_angles(STROKE._replace(down_from=0.8, down_to=0.2), np.zeros(1))


def test_section_velocities_are_the_derivatives_of_the_places() -> None:
    motion = twisting(4000)
    instants = protocol_motions(WING, motion)
    places = np.array([instant.place for instant in instants])
    dt = 1.0 / (STROKE.frequency * len(instants))
    velocity = (np.roll(places, -1, axis=0) - np.roll(places, 1, axis=0)) / (2.0 * dt)
    for i in range(100, 4000, 470):
        span, chord, normal = instants[i].axes
        assert instants[i].along == pytest.approx((velocity[i] * chord).sum(axis=0), abs=1e-3)
        assert instants[i].down == pytest.approx(-(velocity[i] * normal).sum(axis=0), abs=1e-3)
        assert instants[i].outward == pytest.approx((velocity[i] * span).sum(axis=0), abs=1e-3)


def test_a_turning_fuselage_carries_its_sections_along() -> None:
    omega, motion = np.array([0.3, -0.5, 0.8]), steady_flight(STROKE, 6, 0.0)
    motion = motion._replace(flap_rate=np.zeros(6), omega=np.tile(omega, (6, 1)))
    for instant in protocol_motions(WING, motion):
        carried = np.cross(omega, instant.place.T)
        assert instant.along == pytest.approx((carried * instant.axes[1].T).sum(axis=1), abs=1e-12)
        assert instant.down == pytest.approx(-(carried * instant.axes[2].T).sum(axis=1), abs=1e-12)
        assert instant.pitch_rate == pytest.approx(omega @ (instant.axes[0] * np.sign(instant.axes[0, 1])))


def test_the_axes_are_right_angled_and_the_left_wing_mirrors_the_right() -> None:
    instant = protocol_motions(WING, twisting(16))[5]
    for k in range(len(instant.along)):
        axes = instant.axes[:, :, k]
        assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    half = len(WING.span)
    assert instant.place[:, :half] == pytest.approx(instant.place[:, half:] * np.array([[1.0], [-1.0], [1.0]]))
    left, right = (section_velocity(WING, twisting(16), 0.5, side) for side in (LEFT, RIGHT))
    assert left.down == pytest.approx(right.down) and left.along == pytest.approx(right.along)
    assert strips_of(WING).wing.tolist() == [0.0] * half + [1.0] * half


def test_gliding_level_every_section_meets_the_same_flow() -> None:
    motion = steady_flight(STROKE._replace(highest=0.0, lowest=0.0), 8, 10.0, 0.1)
    fields = spatial_kinematics(WING, motion, density=1.2, viscosity=1.8e-5)
    assert fields.speed == pytest.approx(np.full((10, 8), 10.0))
    assert fields.angle_of_attack == pytest.approx(np.full((10, 8), 0.1))
    assert fields.reynolds[:, 0] == pytest.approx(1.2 * 10.0 * WING.chord / 1.8e-5)
    assert fields.reduced_frequency[:, 0] == pytest.approx(math.pi * 5.0 * WING.chord / 10.0)


def test_twist_adds_to_the_angle_of_attack_towards_the_tip() -> None:
    motion = steady_flight(STROKE._replace(highest=0.0, lowest=0.0), 8, 10.0)
    fields = spatial_kinematics(WING, motion._replace(twist=np.full(8, 0.3)))
    assert fields.angle_of_attack[:, 0] == pytest.approx(0.3 * fields.eta)


def test_a_wing_at_rest_has_no_reduced_frequency_and_raises_no_alarm() -> None:
    motion = steady_flight(STROKE._replace(highest=0.0, lowest=0.0), 8, 0.0)
    fields = spatial_kinematics(WING, motion)
    assert np.all(np.isinf(fields.reduced_frequency)) and np.all(fields.reynolds == 0.0)


def test_the_picture_shows_four_labelled_fields(tmp_path: Path) -> None:
    image = pytest.importorskip("matplotlib.image")
    fields = spatial_kinematics(WING, steady_flight(SLOW_HAWK_STROKE, 60, 9.2))
    draw_spatial(fields, tmp_path / "stroke.png", "a stroke")
    pixels = image.imread(tmp_path / "stroke.png")[..., :3]
    coloured = np.ptp(pixels, axis=2) > 0.2
    height, width = coloured.shape
    for rows in (slice(0, height // 2), slice(height // 2, None)):
        for columns in (slice(0, width // 2), slice(width // 2, None)):
            assert coloured[rows, columns].mean() > 0.2


def test_without_matplotlib_one_line_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = builtins.__import__

    def without(
        name: str,
        globals: Mapping[str, object] | None = None,
        locals: Mapping[str, object] | None = None,
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> Any:
        if name.startswith("matplotlib"):
            raise ImportError(name)
        return original(name, globals, locals, fromlist, level)

    monkeypatch.setattr(builtins, "__import__", without)
    fields = spatial_kinematics(WING, steady_flight(STROKE, 8, 9.2))
    with pytest.raises(InputError, match="drawing needs matplotlib"):
        draw_spatial(fields, tmp_path / "stroke.png", "a stroke")
    assert not (tmp_path / "stroke.png").exists()
