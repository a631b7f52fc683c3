"""Inputs and strokes found where no topic tells them: all that were flown, and nothing that was not."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly, model_of

from logs.identification.data.flight import FlightData
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.models.modes import short_period_of
from logs.identification.results import Array
from logs.identification.sources.detection import detect_inputs, flapping_frequency, strokes_in
from wingbeat.errors import InputError

STEP = 0.005
TIME = np.arange(0.0, 30.0, STEP)
STROKES = 4.0 * TIME


def bump(begin: float, length: float, size: float) -> Array:
    """A stick moved smoothly there and back."""
    share = np.clip((TIME - begin) / length, 0.0, 1.0)
    moved: Array = size * np.sin(np.pi * share) ** 2
    return moved


def detected(elevator: Array, strokes: Array = STROKES) -> list[float]:
    """When each input that is found begins (s)."""
    number = detect_inputs(TIME, elevator, strokes)
    moved = np.where(np.abs(number.excitation) > 0.01, number.manoeuvre, 0.0)
    return [float(TIME[moved == one][0]) for one in np.unique(moved[moved > 0])]


def test_the_doublets_that_were_flown_are_found() -> None:
    data = fly(Flight(doublets=5))
    inputs = detect_inputs(data.time, data.elevator, data.strokes)
    np.testing.assert_allclose(inputs.excitation, data.excitation, atol=1e-12)
    flown, taken = data.excitation != 0.0, inputs.active > 0.0
    assert taken[flown].all() and inputs.manoeuvre.max() == 5
    assert np.unique(inputs.manoeuvre[flown]).tolist() == [1, 2, 3, 4, 5]


def test_a_stick_moved_by_hand_is_an_input() -> None:
    assert detected(0.03 + bump(8.0, 0.6, 0.1) - bump(20.0, 0.4, 0.1)) == pytest.approx([8.1, 20.1], abs=0.1)


def test_what_a_stabilisation_moves_is_none() -> None:
    """GIVEN a loop that answers to the motion, and a pulse among its answers THEN there is no input at rest."""
    answers = 0.05 * np.sin(2 * np.pi * 1.3 * TIME) + 0.02 * np.sin(2 * np.pi * 4.0 * TIME)
    with pytest.raises(InputError, match="nowhere moves quickly from rest to rest"):
        detect_inputs(TIME, answers + bump(10.0, 0.5, 0.1), STROKES)


@pytest.mark.parametrize("elevator", [0.1 + 0 * TIME, 0.02 * TIME, bump(5.0, 8.0, 0.3), bump(29.6, 0.3, 0.1)])
def test_rest_trim_and_the_end_of_the_record_are_none(elevator: Array) -> None:
    with pytest.raises(InputError):
        detect_inputs(TIME, elevator, STROKES)


def test_an_input_in_a_glide_is_none() -> None:
    gliding = np.minimum(STROKES, 4.0 * 15.0)
    assert detected(bump(8.0, 0.5, 0.1) + bump(20.0, 0.5, 0.1), gliding) == pytest.approx([8.1], abs=0.1)


# --- strokes ----------------------------------------------------------------------------------------------


def flapped(rate: Array) -> tuple[Array, Array]:
    """Strokes, and a signal that they repeat: its second harmonic is the strongest, and there is noise."""
    strokes = np.cumsum(rate) * STEP
    noise = np.random.default_rng(1).normal(size=len(rate))
    return strokes, np.sin(2 * np.pi * strokes) + 2.0 * np.cos(4 * np.pi * strokes + 1.0) + 0.3 * noise


def test_strokes_are_counted_while_their_rate_wanders() -> None:
    strokes, signal = flapped(4.0 + 0.3 * np.sin(2 * np.pi * TIME / 12.0))
    assert flapping_frequency(STEP, signal) == pytest.approx(4.0, abs=0.4)
    counted = strokes_in(TIME, signal)
    assert np.all(np.diff(counted) >= 0.0)
    error = (counted - strokes)[200:-200]
    assert np.ptp(error) < 0.1


def test_wings_that_stand_still_make_no_strokes() -> None:
    _, signal = flapped(np.full(len(TIME), 4.0))
    counted = strokes_in(TIME, np.where(TIME < 20.0, signal, 0.05 * signal))
    assert counted[-1] - counted[TIME < 21.0][-1] < 0.5


@pytest.mark.parametrize("signal", [0.0 * TIME, np.random.default_rng(2).normal(size=len(TIME)), 0.1 * TIME])
def test_nothing_that_flaps_is_said(signal: Array) -> None:
    with pytest.raises(InputError, match="repeats itself"):
        strokes_in(TIME, signal)


def without_topics(data: FlightData) -> FlightData:
    strokes = strokes_in(data.time, data.accel_z)
    inputs = detect_inputs(data.time, data.elevator, strokes)
    return data._replace(
        strokes=strokes, active=inputs.active, manoeuvre=inputs.manoeuvre, excitation=inputs.excitation
    )


@pytest.mark.validate
def test_forty_flights_without_phase_and_excitation_cover_the_truth() -> None:
    frequency, damping = short_period_of(model_of(Flight()).a)
    for method in (0, 1):
        covered = np.zeros(2)
        for seed in range(40):
            mode = identify_modes(without_topics(fly(Flight(seed=seed, modulation=0.3))), AIRCRAFT).modes[method]
            assert mode.frequency is not None and mode.damping is not None
            covered += mode.frequency.contains(frequency), mode.damping.contains(damping)
        assert covered.min() >= 34
