"""The short period of a flapping aircraft with known derivatives is found within its interval."""

from __future__ import annotations

import math

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, REFERENCE, STEP, TRUTH, Flight, by_output_error, fly, model_of

from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.data.maneuvers import find_manoeuvres, reference_of
from logs.identification.estimators.flight import short_period
from logs.identification.estimators.flight.equation_error import DerivativeFit, equation_error, failed, signals
from logs.identification.estimators.flight.filter_error import Filtered, filter_error
from logs.identification.estimators.flight.gust_ekf_data import Task
from logs.identification.estimators.flight.output_error import LOST, flown_regressors
from logs.identification.estimators.flight.short_period import (
    FILTER_ERROR,
    FITTED_OUTPUTS,
    OUTPUT_ERROR,
    fit_derivatives,
    identify_modes,
)
from logs.identification.estimators.flight.simulation import Problem
from logs.identification.models.modes import SHORT_PERIOD as SHORT
from logs.identification.models.modes import ModesResult, paired_mode, short_period_of
from logs.identification.models.stroke_averaged import LONGITUDINAL, SHORT_PERIOD
from logs.identification.results import Array
from logs.identification.statistics.delta_method import propagate
from logs.identification.statistics.parameter_uncertainty import Spread
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


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_a_stroke_that_modulates_short_records_is_followed_until_it_settles(seed: int) -> None:
    """GIVEN two seconds a record, and derivatives that swing THEN two steps with the swing are not enough."""
    mode = by_output_error(fly(Flight(seed=seed, settle=0.8, modulation=0.3)))
    assert mode.frequency is not None
    held = [estimate.contains(TRUTH[estimate.name]) for estimate in mode.derivatives]
    assert sum(held) >= 10  # of 12


def test_without_noise_or_shaking_output_error_is_exact() -> None:
    mode = by_output_error(fly(Flight(noise=0.0, shaking=0.0)))
    frequency, damping = true_mode(Flight())
    assert mode.frequency is not None and mode.damping is not None
    assert mode.frequency.value == pytest.approx(frequency, rel=2e-3)
    assert mode.damping.value == pytest.approx(damping, abs=2e-3)


def test_the_short_period_approximation_alone_is_biased_which_is_why_speed_is_in_the_model() -> None:
    data = fly(Flight())
    truth = true_mode(Flight())[0]
    full, short = (
        by_output_error(data, AIRCRAFT, names, outputs).frequency
        for names, outputs in ((LONGITUDINAL, (0, 1, 2)), (SHORT_PERIOD, (0, 2)))
    )
    assert full is not None and short is not None
    assert abs(full.value - truth) < 0.2 * abs(short.value - truth)


@pytest.fixture(scope="module")
def of_unknown_lag() -> ModesResult:
    """By every method, of a flight whose tail's lag is not known."""
    return identify(Flight(seed=1), Aircraft(imu_x=0.05))


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


def test_the_reference_condition_comes_from_the_flight() -> None:
    result = identify(Flight())
    assert result.manoeuvres == 6
    np.testing.assert_allclose(result.reference, REFERENCE, atol=0.03)


def moving(time: Array, trend: float = 0.0) -> tuple[FlightData, Array]:
    """A flight of a chosen motion that ends as it began after 2 pi s, and its speeds u and w in m/s (N, 2).

    ``trend`` in m/s^2 is by what u does not end as it began.
    """
    turn, swing = 5.0 * time, 3.0 * time
    q, pitch = 1.2 * np.cos(turn), 0.1 + 0.24 * np.sin(turn)
    u, w = 7.0 + 0.4 * np.sin(turn + 0.6) + trend * (time - np.pi), 0.7 + 0.15 * np.sin(swing)
    u_dot, w_dot = 2.0 * np.cos(turn + 0.6) + trend, 0.45 * np.cos(swing)
    a_x = u_dot + w * q + STANDARD_GRAVITY * np.sin(pitch) + 0.05
    a_z = w_dot - u * q - STANDARD_GRAVITY * np.cos(pitch) - 0.05
    airspeed, still, on = np.hypot(u, w), np.zeros_like(time), np.ones_like(time)
    excited = np.where((time > 2.0) & (time < 2.2), 0.1, 0.0)
    strokes, sideways = 4.0 * time, [still] * 4
    data = FlightData(
        time, q, a_x, a_z, pitch, airspeed, still, excited, strokes, on, on, excited, still, still, *sideways
    )
    return data, np.column_stack((u, w))


def test_speeds_are_reconstructed_where_the_airspeed_changes_with_the_pitch_rate() -> None:
    data, speeds = moving(np.linspace(0.0, 6.28, 1257))
    aircraft = Aircraft(tail_time_constant=0.0)
    (manoeuvre,) = find_manoeuvres(data, aircraft)
    found = signals(manoeuvre, reference_of(data, (manoeuvre,)), aircraft).regressors[:, :2]
    true = manoeuvre.averaging @ speeds[: len(manoeuvre.time)]
    np.testing.assert_array_less(*apart(found, true))


def apart(found: Array, true: Array) -> tuple[Array, Array]:
    """Scatter of ``found`` speeds (M, 2) about the ``true`` ones but for a drift, and 2 % of their own: m/s, (2,)."""
    drift = np.vander(np.linspace(-1, 1, len(true)), 3)
    left = [x - drift @ np.linalg.lstsq(drift, x, rcond=None)[0] for x in (found, true)]
    return np.std(left[0] - left[1], axis=0), 0.02 * np.std(left[1], axis=0)


def test_speeds_that_do_not_end_as_they_began_take_their_trend_from_a_model_that_was_flown() -> None:
    """GIVEN an airspeed that falls WHEN it is multiplied with the pitch rate THEN no drift makes up for it."""
    data, speeds = moving(np.linspace(0.0, 6.28, 1257), trend=-0.2)
    aircraft = Aircraft(tail_time_constant=0.0)
    (manoeuvre,) = find_manoeuvres(data, aircraft)
    reference, true = reference_of(data, (manoeuvre,)), manoeuvre.averaging @ speeds[: len(manoeuvre.time)]
    plain, known = (signals(manoeuvre, reference, aircraft, flown).regressors[:, :2] for flown in (None, true))
    np.testing.assert_array_less(*apart(known, true))
    scatter, most = apart(plain, true)
    assert scatter[1] > 3 * most[1]


def fits_of(flight: Flight) -> tuple[DerivativeFit, DerivativeFit]:
    """By equation error and by output error."""
    data = fly(flight)
    manoeuvres = find_manoeuvres(data, AIRCRAFT)
    problem = Problem(manoeuvres, reference_of(data, manoeuvres), AIRCRAFT, LONGITUDINAL, FITTED_OUTPUTS)
    return fit_derivatives(problem)


def derivatives_by_equation_error(flight: Flight) -> dict[str, float]:
    fit, _ = fits_of(flight)
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def test_what_shakes_with_the_wings_stays_out_of_the_products(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN wings that beat evenly WHEN they shake the sensors THEN w is not off by 0.3 %, nor is M_w."""
    monkeypatch.setattr("linear_ornithopter.wing_strokes", lambda _rng, count, _jitter: 4.0 * STEP * np.arange(count))
    still, shaken = (
        derivatives_by_equation_error(Flight(width=0.4, noise=1e-4, shaking=shaking)) for shaking in (0.0, 1.0)
    )
    assert shaken["M_w"] == pytest.approx(still["M_w"], abs=0.018)


def test_a_stroke_that_modulates_does_not_move_the_mean_derivatives() -> None:
    """GIVEN M_w and M_q that swing by 0.3 THEN what they swing to second order is not taken for their means."""
    found = derivatives_of(Flight(width=0.4, amplitude=0.05, modulation=0.3, noise=1e-3, shaking=0.0))
    assert [found[name] for name in ("M_w", "M_q")] == pytest.approx([TRUTH["M_w"], TRUTH["M_q"]], abs=0.015)


def test_large_motions_that_a_stroke_modulates_do_not_move_what_the_speed_does() -> None:
    """GIVEN 0.15 rad of elevator for 0.4 s and a stroke that modulates THEN both are taken off together.

    Each for itself, Z_u and M_u came out 0.056 and 0.076 off.
    """
    found = derivatives_of(Flight(width=0.4, modulation=0.3, noise=1e-3, shaking=0.0))
    assert [found[name] for name in ("Z_u", "M_u")] == pytest.approx([TRUTH["Z_u"], TRUTH["M_u"]], abs=0.015)
    assert [found[name] for name in ("M_w", "M_q")] == pytest.approx([TRUTH["M_w"], TRUTH["M_q"]], abs=0.025)


def derivatives_of(flight: Flight) -> dict[str, float]:
    return {one.name: one.value for one in by_output_error(fly(flight)).derivatives}


def test_a_repeated_input_is_cut_into_pieces() -> None:
    data = fly(Flight(doublets=4))
    joined = data._replace(active=np.ones_like(data.active), manoeuvre=np.ones_like(data.manoeuvre))
    assert len(find_manoeuvres(joined, AIRCRAFT)) == 4


def test_nothing_is_printed_where_the_elevator_hardly_moved() -> None:
    result = identify(Flight(amplitude=1e-5, seed=2))
    for mode in result.modes:
        if mode.frequency is None:
            assert mode.unidentified[0].reason
        else:
            assert mode.frequency.high - mode.frequency.value > 0.05 * mode.frequency.value
    assert any(mode.frequency is None for mode in result.modes)


def test_an_aborted_manoeuvre_is_left_out() -> None:
    data = fly(Flight(doublets=4))
    aborted = np.where((data.manoeuvre == 2) & (data.active > 0), 1.0, 0.0)
    assert len(find_manoeuvres(data._replace(aborted=aborted), AIRCRAFT)) == 3


@pytest.mark.parametrize(
    ("field", "value", "what"),
    [("excitation", 0.0, "manoeuvre"), ("strokes", 0.0, "manoeuvre"), ("airspeed", 0.0, "airspeed")],
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
    value, error = propagate(lambda v: np.array([2 * v[0] - v[1]]), np.array([1.0, 5.0]), covariance)
    assert value[0] == -3
    assert error[0] == pytest.approx(math.sqrt(4 * 0.04 + 0.09 - 4 * 0.01))


@pytest.mark.parametrize("seed", [3, 2001])
def test_in_strong_gusts_only_the_method_that_knows_of_gusts_gives_a_number(seed: int) -> None:
    """GIVEN gusts of 2 m/s, which move the aircraft more than its elevator does."""
    result = identify(Flight(seed=seed, gust=2.0))
    given = {mode.method: mode for mode in result.modes if mode.frequency is not None}
    assert set(given) == {FILTER_ERROR}
    frequency, damping = true_mode(Flight())
    found = given[FILTER_ERROR]
    assert found.frequency is not None and found.frequency.contains(frequency)
    assert found.frequency.high < 1.4 * found.frequency.value
    assert found.damping is not None and found.damping.contains(damping)
    assert "gusts" in result.modes[1].unidentified[0].reason
    assert result.statement.startswith("filter error alone")


def test_weak_instruments_are_refused() -> None:
    """GIVEN instruments that tell next to nothing of w THEN what noise makes of M_w is no number."""
    data = fly(Flight(seed=1, doublets=4))
    manoeuvres = find_manoeuvres(data, AIRCRAFT)
    reference = reference_of(data, manoeuvres)
    pieces = [signals(m, reference, AIRCRAFT).regressors for m in manoeuvres]
    rng = np.random.default_rng(2)
    strong = [np.hstack((piece, 0.01 * rng.normal(size=(len(piece), 4)))) for piece in pieces]
    weak = [columns.copy() for columns in strong]
    for columns in weak:
        columns[:, 1] = columns[:, 0] + 1e-3 * rng.normal(size=len(columns))
    given, lost = (equation_error(manoeuvres, reference, AIRCRAFT, LONGITUDINAL, z) for z in (strong, weak))
    assert not given.failure
    assert lost.failure


def test_a_model_whose_motion_is_not_the_measured_one_gives_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a fit whose own motion has no w THEN neither method is believed."""

    def strange(problem: Problem, fit: DerivativeFit) -> list[Array]:
        flown = flown_regressors(problem, fit)
        return [columns * (np.arange(columns.shape[1]) != 1) for columns in flown]

    monkeypatch.setattr(short_period, "flown_regressors", strange)
    by_equation, by_output = fits_of(Flight(seed=1))
    assert "is not the measured one" in by_output.failure
    assert by_equation.failure


def test_where_output_error_is_lost_no_method_that_knows_of_no_gusts_is_believed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """GIVEN an output error that did not converge THEN only filter error, which has its own start, gives a number."""

    def lost(problem: Problem, start: Array) -> DerivativeFit:
        return failed(problem.names, LOST)

    monkeypatch.setattr(short_period, "output_error", lost)
    given = {mode.method for mode in identify(Flight(seed=1)).modes if mode.frequency is not None}
    assert given == {FILTER_ERROR}


def test_what_filter_error_contradicts_in_gusts_gives_no_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a filter error with another frequency THEN in gusts it is believed, in calm air output error is."""

    fits: list[tuple[DerivativeFit, Filtered | None]] = []

    def kept(task: Task, start: Array) -> tuple[DerivativeFit, Filtered | None]:
        fits.append(filter_error(task, start))
        return fits[-1]

    def elsewhere(task: Task, start: Array) -> tuple[DerivativeFit, Filtered | None]:
        fit, found = fits.pop() if fits else filter_error(task, start)
        return fit._replace(values=fit.values * np.where(np.array(fit.names) == "M_w", 3.0, 1.0)), found

    monkeypatch.setattr(short_period, "filter_error", kept)
    believed = {mode.method for mode in identify(Flight(seed=5001, gust=0.3)).modes if mode.frequency is not None}
    monkeypatch.setattr(short_period, "filter_error", elsewhere)
    gusty, calm = (identify(Flight(seed=5001, gust=gust)) for gust in (0.3, 0.0))
    assert {"output error", "equation error, frequency domain"} <= believed
    assert [mode.method for mode in gusty.modes if mode.frequency is not None] == [FILTER_ERROR]
    assert "differs from that of filter error" in gusty.modes[0].unidentified[0].reason
    assert "gusts" in gusty.modes[1].unidentified[0].reason
    assert all(fit.failure for fit in gusty.fits[:2]), "no model is written of them"
    assert all(mode.frequency is not None for mode in calm.modes[:3]) and calm.agree is False


def test_a_motion_that_gusts_rang_is_not_taken_for_the_aircrafts(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a sure free response far from filter error's mode THEN in gusts it is refused, in calm air told."""
    rung = paired_mode(
        "free response", (SHORT,), np.array([19.1, -0.05]), Spread(np.diag([0.03, 1e-5]), 100.0)
    )  # fmt: skip
    monkeypatch.setattr(short_period, "modes_of_records", lambda records, kinds: (rung,))
    gusty, calm = (identify(Flight(seed=5001, gust=gust)) for gust in (0.3, 0.0))
    assert gusty.fits[0].failure == "" and gusty.modes[-1].frequency is None
    assert "differs from that of filter error" in gusty.modes[-1].unidentified[0].reason
    assert calm.modes[-1].frequency is not None and calm.agree is False


def test_a_tail_lag_that_is_not_known_is_found_by_filter_error_too(of_unknown_lag: ModesResult) -> None:
    found = of_unknown_lag.modes[2]
    lag = found.derivatives[-1]
    assert found.method == FILTER_ERROR and lag.name == "tail_time_constant"
    assert lag.value == pytest.approx(0.04, abs=0.006)


@pytest.mark.validate
@pytest.mark.parametrize("gust", [0.5, 0.7, 2.0])
def test_frequencies_given_in_gusts_hold_the_truth(gust: float) -> None:
    """What output error (0) and equation error (1) give in gusts, and that in 2 m/s they give next to nothing."""
    truth = true_mode(Flight())[0]
    results = [identify(Flight(seed=seed, gust=gust)) for seed in range(5000, 5300)]
    for method in (0, 1):
        given = [f for f in (result.modes[method].frequency for result in results) if f is not None]
        held = sum(frequency.contains(truth) for frequency in given)
        median = float(np.median([frequency.value / truth - 1 for frequency in given])) if given else 0.0
        print(f"gusts {gust} m/s, method {method}: {len(given)} given, {held} hold, {median:+.3f}")  # noqa: T201
        assert held >= 0.85 * len(given)
        assert gust < 1.0 or len(given) <= 0.05 * len(results)


def test_in_gusts_methods_without_a_physical_model_refuse_and_say_why() -> None:
    """GIVEN gusts that ring the aircraft as its inputs do THEN no transfer function and no ring-down is believed."""
    found = {mode.method: mode for mode in identify(Flight(seed=2, gust=0.5)).modes}
    for method in ("equivalent system", "free response", "spectrum"):
        assert found[method].frequency is None
        assert found[method].unidentified[0].reason


def test_a_lightly_damped_mode_is_found_by_every_method_that_its_records_allow() -> None:
    flight = Flight(seed=1, truth=TRUTH | {"M_q": -0.5, "Z_w": -1.0}, settle=2.5)
    result = identify(flight)
    given = {mode.method: mode.frequency for mode in result.modes if mode.frequency is not None}
    assert {"output error", "equation error, frequency domain", "equivalent system", "free response"} <= set(given)
    assert all(found.value == pytest.approx(true_mode(flight)[0], rel=0.01) for found in given.values())
    assert result.agree
