"""Kim's factor or DeLaurier's fixed limit: the choice in a vehicle file and what it does to a section."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sim_bridge.aerodynamics.protocol import Strips
from sim_bridge.aerodynamics.strip_theory import (
    STALL_BLEND,
    Section,
    SectionMotion,
    StripParameters,
    StripTheory,
    build,
    half_stroke_travel,
    section_loads,
)
from wingbeat.errors import InputError

CHORD, SPEED, DENSITY, STALL = 0.2, 8.0, 1.2, 0.25


def parameters(dynamic_stall: str) -> StripParameters:
    ones = np.ones(4)
    wing = Strips(0.1 * np.arange(1.0, 5.0), 0.2 * ones, CHORD * ones, 0.1 * ones, 0.0 * ones)
    return build(StripTheory(0.0, 1.0, STALL, 1.0, dynamic_stall), wing)


def plunging(p: StripParameters, incidence: float, flapping: float) -> Section:
    """A section whose wake has settled; ``flapping`` is the share of its downward speed that its joint gives."""
    down = SPEED * math.tan(incidence) / p.lift_factor
    return section_loads(SectionMotion(SPEED, flapping * down, down, 0.0, CHORD), DENSITY, down, p)


@pytest.mark.parametrize("incidence", [0.5 * STALL, STALL + 0.02, 1.5 * STALL, 3.0 * STALL])
def test_the_fixed_limit_knows_no_plunge(incidence: float) -> None:
    p = parameters("fixed")
    assert plunging(p, incidence, 1.0) == plunging(p, incidence, 0.0)


def test_at_the_limit_itself_half_the_section_is_stalled() -> None:
    assert plunging(parameters("fixed"), STALL, 1.0).stalled == pytest.approx(0.5)
    assert plunging(parameters("kim"), STALL, 0.0).stalled == pytest.approx(0.5)
    assert plunging(parameters("kim"), 2.0 * STALL, 1.0).stalled == pytest.approx(0.5)


def test_with_kims_factor_a_plunging_section_stays_attached_to_twice_the_angle() -> None:
    assert plunging(parameters("kim"), 2.0 * STALL - STALL_BLEND, 1.0).stalled == 0.0
    assert plunging(parameters("kim"), 2.0 * STALL + STALL_BLEND, 1.0).stalled == 1.0


@pytest.mark.parametrize("incidence", [0.5 * STALL, 3.0 * STALL])
def test_far_from_the_limits_the_choice_does_nothing(incidence: float) -> None:
    assert plunging(parameters("fixed"), incidence, 1.0) == plunging(parameters("kim"), incidence, 1.0)


def test_an_unknown_choice_is_told_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r'dynamic_stall = "helicopter" is unknown; it is fixed or kim'):
        parameters("helicopter")


def test_travel_in_half_a_stroke_is_pi_over_twice_the_reduced_frequency() -> None:
    reduced = CHORD * 2.0 * math.pi * 4.0 / (2.0 * SPEED)
    assert half_stroke_travel(SPEED, 4.0, CHORD) == pytest.approx(math.pi / (2.0 * reduced))
