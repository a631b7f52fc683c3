"""Yeo, Atkins and Shyy 2011: lift of a rigid flapping wing from pressures over one stroke. Nothing is fitted."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from sim_bridge.aerodynamics.strip_theory import FORMATION, half_stroke_travel
from sim_bridge.validation.row import WITHIN
from sim_bridge.validation.yeo import (
    AIRSPEED,
    DIGITISED_RMS,
    ERROR_AT_MOST,
    FREQUENCY,
    OUTER_TAPS,
    OUTER_WITHIN,
    OUTERMOST,
    PANELS,
    RMS_WITHIN,
    ROOT_CHORD,
    SEMISPAN,
    STEPS,
    STROKE_AT_MOST,
    edges,
    flap,
    lift_rows,
    mean_error,
    measured_lift,
    measured_normal,
    modelled_lift,
    modelled_normal,
    outer_strength,
    read,
    rms,
    section,
    stroke_time,
    wings,
)


def test_the_panels_cover_the_wing() -> None:
    strips = wings()
    panels = sum(width * height for rows in PANELS.values() for width, height in rows)
    assert 2.0 * panels == pytest.approx(float(np.sum(strips.chord * strips.width)), rel=0.02)


def test_the_outermost_panels_lie_inside_the_outline() -> None:
    """The trailing edge curves to the tip, so that the leading panel is the longest."""
    span = np.linspace(OUTERMOST, SEMISPAN, 2001)
    leading, trailing = edges(span)
    for behind, (width, _) in zip(OUTER_TAPS, PANELS["green"], strict=True):
        ahead = ROOT_CHORD - behind
        inside = float(np.mean((ahead < leading) & (ahead > trailing))) * (SEMISPAN - OUTERMOST)
        assert inside == pytest.approx(width, abs=0.003)


def test_the_sum_of_the_pressures_is_the_lift_that_was_digitised() -> None:
    assert rms(measured_lift()) == pytest.approx(DIGITISED_RMS, abs=0.0001)


def test_the_motion_is_the_measured_one() -> None:
    positions = read("measured_wing_positions.csv")
    assert flap(positions[:, 0])[:, 0] == pytest.approx(np.radians(positions[:, 1]), abs=0.07)


def test_the_steps_of_a_stroke_are_fine_enough() -> None:
    p = section("fixed")
    assert rms(modelled_lift(p)) == pytest.approx(rms(modelled_lift(p, 8 * STEPS)), rel=2e-3)


def test_a_half_stroke_outlasts_a_leading_edge_vortex() -> None:
    assert half_stroke_travel(AIRSPEED, FREQUENCY, ROOT_CHORD) > FORMATION


def test_rms_lift_within_five_percent() -> None:
    assert rms(modelled_lift(section("fixed"))) == pytest.approx(rms(measured_lift()), rel=RMS_WITHIN)


def test_mean_absolute_error_of_the_lift() -> None:
    assert mean_error(section("fixed")) <= ERROR_AT_MOST


def test_the_lift_of_the_stroke_has_the_measured_shape() -> None:
    assert np.corrcoef(modelled_lift(section("fixed")), measured_lift())[0, 1] > 0.99


def test_the_outer_wing_is_separated_where_kims_factor_keeps_it_attached() -> None:
    """The pressures themselves tell which stall limit holds: no sum over the wing, no other part of the model."""
    measured = float(measured_normal("green").std())
    assert outer_strength(modelled_normal(section("fixed"))) == pytest.approx(measured, rel=OUTER_WITHIN)
    assert outer_strength(modelled_normal(section("kim"))) > 1.8 * measured


def test_with_kims_factor_lift_is_too_large() -> None:
    assert rms(modelled_lift(section("kim"))) > 1.3 * rms(measured_lift())


def test_without_the_wake_lift_is_too_large() -> None:
    quasi_steady = rms(modelled_lift(section("fixed", wake_lag=0.0)))
    assert quasi_steady > (1.0 + RMS_WITHIN) * rms(measured_lift())


def test_the_measured_mean_lift_is_not_of_the_motion() -> None:
    """Bias of pressures or incidence, 0.18 in lift coefficient: no model of the motion alone can have it."""
    assert abs(float(modelled_lift(section("fixed")).mean())) < 0.1 * float(measured_lift().mean())


def test_every_row_is_within_its_limit_but_the_mean_lift() -> None:
    short = [row.figure.quantity for row in lift_rows() if row.outcome != WITHIN]
    assert short == ["mean lift"]


@pytest.mark.bench
def test_the_time_of_a_stroke() -> None:
    median = stroke_time()
    sys.stdout.write(f"strip theory, one stroke  {median * 1e3:6.3f} ms at the median\n")
    assert median < STROKE_AT_MOST
