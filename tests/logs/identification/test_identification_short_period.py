"""The short period of a flapping aircraft with known derivatives is found within its interval."""

from __future__ import annotations

import math

import numpy as np
import pytest
from linear_ornithopter import (
    AIRCRAFT,
    REFERENCE,
    TRUTH,
    Flight,
    by_output_error,
    flight_problem,
    fly,
    model_of,
)

from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.data.maneuvers import find_maneuvers, reference_of
from logs.identification.estimators.flight_modes import (
    EQUATION_ERROR,
    FILTER_ERROR,
    OUTPUT_ERROR,
    equation_error,
    identify_modes,
    mode_of,
    with_speeds,
)
from logs.identification.models.modes import ModesResult, short_period_of
from logs.identification.models.stroke_averaged import LONGITUDINAL, SHORT_PERIOD
from logs.identification.results import Array
from logs.identification.statistics.covariance import ParameterUncertainty, propagate
from logs.strokes import interval_mean
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError


def true_mode(flight: Flight) -> tuple[float, float]:
    return short_period_of(model_of(flight).a)


def identify(flight: Flight, aircraft: Aircraft = AIRCRAFT) -> ModesResult:
    return identify_modes(fly(flight), aircraft)


def test_derivatives_lie_within_their_intervals() -> None:
    """Of three hundred flights a setting `test_short_period_coverage` asks the same."""
    hits = total = 0
    for seed in range(5):
        for estimate in by_output_error(fly(Flight(seed=seed, modulation=0.2))).derivatives:
            hits += estimate.contains(TRUTH[estimate.name])
            total += 1
    assert hits >= 0.85 * total


def test_without_noise_or_shaking_output_error_is_exact() -> None:
    mode = by_output_error(fly(Flight(noise=0.0, shaking=0.0)))
    frequency, damping = true_mode(Flight())
    assert mode.frequency is not None and mode.damping is not None
    assert mode.frequency.value == pytest.approx(frequency, rel=5e-3)
    assert mode.damping.value == pytest.approx(damping, abs=5e-3)


def test_the_short_period_approximation_alone_is_biased_which_is_why_speed_is_in_the_model() -> None:
    data = fly(Flight())
    truth = true_mode(Flight())[0]
    full, short = (
        by_output_error(data, AIRCRAFT, names, outputs).frequency
        for names, outputs in ((LONGITUDINAL, ("q", "a_x", "a_z")), (SHORT_PERIOD, ("q", "a_z")))
    )
    assert full is not None and short is not None
    assert abs(full.value - truth) < 0.2 * abs(short.value - truth)


@pytest.fixture(scope="module")
def of_unknown_lag() -> ModesResult:
    """By every method, of a flight whose tail's lag is not known."""
    return identify(Flight(seed=1), Aircraft(imu_x=0.05))


@pytest.mark.validate
def test_an_unknown_tail_lag_is_found_with_the_mode(of_unknown_lag: ModesResult) -> None:
    mode = of_unknown_lag.modes[0]
    lag = mode.derivatives[-1]
    assert mode.method == OUTPUT_ERROR and lag.name == "tail_time_constant"
    assert lag.value == pytest.approx(0.04, abs=0.004)
    assert mode.frequency is not None
    assert mode.frequency.value == pytest.approx(true_mode(Flight())[0], rel=0.02)


def test_a_tail_lag_that_is_ignored_shows_as_a_wrong_mode() -> None:
    mode = by_output_error(fly(Flight(seed=1)), AIRCRAFT._replace(tail_time_constant=0.0))
    assert mode.frequency is None or abs(mode.frequency.value / true_mode(Flight())[0] - 1) > 0.1


def test_an_overdamped_mode_has_two_time_constants() -> None:
    heavy = TRUTH | {"M_w": -2.0, "M_q": -14.0}
    flight = Flight(truth=heavy)
    assert true_mode(flight)[1] > 1.05
    mode = by_output_error(fly(flight))
    assert mode.damping is not None and mode.damping.value > 1
    expected = np.sort(-1 / np.sort(np.linalg.eigvals(model_of(flight).a).real)[:2])
    for constant, truth in zip(mode.time_constants, expected, strict=True):
        assert constant.value == pytest.approx(truth, rel=0.2)


@pytest.mark.validate
def test_the_reference_condition_comes_from_the_flight() -> None:
    result = identify(Flight())
    assert result.manoeuvres == 6
    np.testing.assert_allclose(result.reference, REFERENCE, atol=0.03)


def moving(time: Array) -> tuple[FlightData, Array]:
    """A flight of a chosen motion with the period 2 pi s, and its speeds u and w in m/s (N, 2)."""
    turn, swing = 5.0 * time, 3.0 * time
    q, pitch = 1.2 * np.cos(turn), 0.1 + 0.24 * np.sin(turn)
    u, w = 7.0 + 0.4 * np.sin(turn + 0.6), 0.7 + 0.15 * np.sin(swing)
    u_dot, w_dot = 2.0 * np.cos(turn + 0.6), 0.45 * np.cos(swing)
    a_x = u_dot + w * q + STANDARD_GRAVITY * np.sin(pitch) + 0.05
    a_z = w_dot - u * q - STANDARD_GRAVITY * np.cos(pitch) - 0.05
    airspeed, still, on = np.hypot(u, w), np.zeros_like(time), np.ones_like(time)
    excited = np.where((time > 2.0) & (time < 2.2), 0.1, 0.0)
    strokes = 4.0 * time
    data = FlightData(time, q, a_x, a_z, pitch, airspeed, still, excited, strokes, on, on, excited, still)
    return data, np.column_stack((u, w))


def test_speeds_are_integrated_where_the_airspeed_changes_with_the_pitch_rate() -> None:
    data, speeds = moving(np.linspace(0.0, 6.54, 1309))
    (maneuver,) = find_maneuvers(data)
    record = with_speeds(maneuver, reference_of(data, (maneuver,)), Aircraft(tail_time_constant=0.0), 0.0)
    integrated = np.column_stack((record.signals["u"], record.signals["w"]))
    truth = stroke_averages(data.time, speeds, record.time)
    drift = np.vander(np.linspace(-1, 1, len(truth)), 3)
    left = [x - drift @ np.linalg.lstsq(drift, x, rcond=None)[0] for x in (integrated, truth)]
    np.testing.assert_array_less(np.std(left[0] - left[1], axis=0), 0.03 * np.std(left[1], axis=0))


def stroke_averages(time: Array, values: Array, at: Array) -> Array:
    """Means over the 0.25 s about each time of ``at``."""
    return interval_mean(time, values, at - 0.125, at + 0.125)


def test_a_repeated_input_is_cut_into_pieces() -> None:
    data = fly(Flight(doublets=4))
    joined = data._replace(active=np.ones_like(data.active), manoeuvre=np.ones_like(data.manoeuvre))
    assert len(find_maneuvers(joined)) == 4


@pytest.mark.validate
def test_nothing_is_printed_where_the_elevator_hardly_moved() -> None:
    result = identify(Flight(amplitude=1e-5, seed=2))
    for mode in result.modes:
        if mode.frequency is None:
            assert mode.withheld[0].text
        else:
            assert mode.frequency.high - mode.frequency.value > 0.05 * mode.frequency.value
    assert any(mode.frequency is None for mode in result.modes)


def test_an_aborted_manoeuvre_is_left_out() -> None:
    data = fly(Flight(doublets=4))
    aborted = np.where((data.manoeuvre == 2) & (data.active > 0), 1.0, 0.0)
    assert len(find_maneuvers(data._replace(aborted=aborted))) == 3


@pytest.mark.parametrize(
    ("field", "value", "what"),
    [("excitation", 0.0, "maneuver"), ("strokes", 0.0, "maneuver"), ("airspeed", 0.0, "airspeed")],
)
def test_data_without_a_use_is_refused_in_one_line(field: str, value: float, what: str) -> None:
    data = fly(Flight(doublets=2))
    spoilt = data._replace(**{field: np.full_like(data.time, value)})
    with pytest.raises(InputError, match=what) as refusal:
        identify_modes(spoilt, AIRCRAFT)
    assert "\n" not in str(refusal.value)


def test_frequency_and_damping_of_a_known_system() -> None:
    assert short_period_of(np.array([[0.0, 1.0], [-36.0, -6.0]])) == pytest.approx((6.0, 0.5))
    frequency, damping = short_period_of(np.diag([-2.0, -8.0]))
    assert (frequency, damping) == pytest.approx((4.0, 1.25))
    with pytest.raises(ValueError, match="divergence"):
        short_period_of(np.diag([-2.0, 8.0]))


def test_error_propagation_is_linear_in_a_linear_function() -> None:
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    uncertainty = ParameterUncertainty(covariance, math.inf)
    value, found = propagate(lambda v: np.array([2 * v[0] - v[1]]), np.array([1.0, 5.0]), uncertainty)
    assert value[0] == -3
    assert found.standard_errors[0] == pytest.approx(math.sqrt(4 * 0.04 + 0.09 - 4 * 0.01))


@pytest.mark.validate
def test_filter_error_in_turbulence_covers_the_frequency() -> None:
    """GIVEN gusts of 1 m/s THEN turbulence is reported, and filter error is the first method."""
    covered = given = 0
    for seed in (1, 2, 3):
        result = identify(Flight(seed=seed, gust=1.0))
        assert any(one.code == "turbulence" for one in result.findings)
        mode = next(one for one in result.modes if one.method == FILTER_ERROR)
        if mode.frequency is not None:
            assert result.modes[0].method == FILTER_ERROR
            given += 1
            covered += mode.frequency.contains(true_mode(Flight())[0])
    assert given >= 2
    assert covered >= given - 1


def test_calm_flight_has_no_finding_and_all_methods_agree() -> None:
    result = identify(Flight(seed=3))
    assert not result.findings and result.agree
    given = {mode.method: mode for mode in result.modes if mode.frequency is not None}
    assert {OUTPUT_ERROR, EQUATION_ERROR, FILTER_ERROR} <= set(given)
    assert result.results[2].value("M_w") == pytest.approx(TRUTH["M_w"], rel=0.1)


@pytest.mark.parametrize("flight", [Flight(modulation=0.9), Flight(gust=0.2)], ids=["stroke", "gusts"])
def test_disturbances_that_move_the_states_do_not_bias_equation_error(flight: Flight) -> None:
    """GIVEN derivatives that swing with the stroke, or gusts THEN the intervals hold the short period.

    Least squares misses the damping of all six flights, or the frequency of four.
    """
    covered = np.zeros(2)
    for seed in range(6):
        problem = flight_problem(fly(flight._replace(seed=seed)))
        mode = mode_of(EQUATION_ERROR, problem, equation_error(problem, AIRCRAFT.tail_time_constant or 0.0))
        assert mode.frequency is not None and mode.damping is not None
        truth = true_mode(flight)
        covered += [mode.frequency.contains(truth[0]), mode.damping.contains(truth[1])]
    assert np.all(covered >= 5)


def test_large_motion_is_a_finding() -> None:
    result = identify(Flight(seed=1, width=0.4))
    assert [one.code for one in result.findings][:1] == ["large_motion"]


def test_an_unknown_tail_lag_is_estimated_by_filter_error_too(of_unknown_lag: ModesResult) -> None:
    lag = of_unknown_lag.results[2].value("tail_time_constant")
    assert lag == pytest.approx(0.04, abs=0.006)


@pytest.mark.validate
def test_a_lightly_damped_mode_is_found_by_every_method_that_its_records_allow() -> None:
    flight = Flight(seed=1, truth=TRUTH | {"M_q": -0.5, "Z_w": -1.0}, settle=2.5)
    result = identify(flight)
    given = {mode.method: mode.frequency for mode in result.modes if mode.frequency is not None}
    assert {"output error", "equation error, frequency domain", "filter error"} <= set(given)
    assert all(found.value == pytest.approx(true_mode(flight)[0], rel=0.02) for found in given.values())
