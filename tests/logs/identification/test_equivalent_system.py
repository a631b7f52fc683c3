"""The equivalent system of short records: what it tells of them, and when it tells nothing."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly, model_of

from logs.identification.modes.equivalent_system import equivalent_system
from logs.identification.modes.mode import Mode, short_period_of
from logs.identification.modes.noise_spectrum import power_law
from logs.identification.modes.records import averaged_records
from logs.identification.preparing.manoeuvre import find_manoeuvres

FREQUENCY, DAMPING = short_period_of(model_of(Flight()).a)


def found(flight: Flight) -> Mode:
    return equivalent_system(averaged_records(find_manoeuvres(fly(flight), AIRCRAFT)))


def held(mode: Mode) -> bool:
    assert mode.frequency is not None and mode.damping is not None
    return mode.frequency.contains(FREQUENCY) and mode.damping.contains(DAMPING)


def test_records_of_two_seconds_hold_the_truth() -> None:
    """GIVEN six frequencies a record THEN what its ends take of the lowest is not taken for an absence of noise."""
    modes = [found(Flight(seed=seed, settle=0.83)) for seed in range(6)]
    assert all(held(mode) for mode in modes)
    off = [mode.frequency.value / FREQUENCY - 1.0 for mode in modes if mode.frequency]
    assert abs(np.median(off)) < 0.05


def test_inputs_at_one_phase_of_the_stroke_are_refused() -> None:
    """GIVEN doublets twelve strokes apart THEN what swings with the stroke is the same in all of them."""
    mode = found(Flight(modulation=0.3, settle=0.8))
    assert mode.frequency is None
    assert "much the same phase of the stroke" in mode.unidentified[0].reason
    assert held(found(Flight(modulation=0.15, settle=0.83)))


def test_records_that_are_half_ends_are_refused() -> None:
    mode = found(Flight(settle=0.6))
    assert mode.frequency is None
    assert "half of what they hold is how they begin and end" in mode.unidentified[0].reason


@pytest.mark.parametrize("flight", [Flight(gust=0.15, seed=1), Flight(modulation=0.3, settle=0.85)])
def test_what_is_not_explained_is_not_hidden_by_weights(flight: Flight) -> None:
    """GIVEN gusts, or a stroke that swings the derivatives THEN whitened residuals do not make a model of them."""
    mode = found(flight)
    assert mode.frequency is None
    assert "explains too little" in mode.unidentified[0].reason


def test_noise_has_its_power_law_whatever_the_fit_took() -> None:
    """GIVEN a fit that leaves next to nothing of the low frequencies THEN their noise is what it is."""
    rng = np.random.default_rng(4)
    frequency = np.tile(np.arange(1.0, 9.0), 400)
    degrees = 2.0 * (1.0 - np.exp(-frequency / 4.0)) ** 2
    power = np.exp(0.7 - 1.5 * np.log(frequency)) * rng.chisquare(degrees)
    np.testing.assert_allclose(power_law(frequency, power, degrees), [0.7, -1.5], atol=0.15)
    level, slope = power_law(frequency, power, np.full_like(degrees, 2.0))
    assert slope > -0.5 and level < 0.0
