"""Torque and power models of drives with known constants, measured as the flight computer does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from promised import SEEDS, promise_kept
from wing_drives import CENTRE, K_TAU, K_TAU0, Drives, exact, law, measure, simulate

from logs.identification.data.flight import DriveData, GaugeErrors
from logs.identification.estimators.servo import identify_torque
from logs.identification.estimators.servo_power import identify_power, power_truth, power_with_gauge_errors
from logs.identification.results import Estimate, EstimationResult
from wingbeat.errors import InputError

SHORT = Drives(duration=25.0)


def simulated(drives: Drives) -> DriveData:
    return measure(simulate(drives), drives)


def by_name(model: EstimationResult) -> dict[str, Estimate]:
    return {estimate.name: estimate for estimate in model.estimates}


LAW = {"C_A": -2.25, "C_B": 12.3, "C_C": 0.0, "C_F": 0.0, "C_G": 3.4, "C_H": 0.0}
LAWFUL = SHORT._replace(law=tuple(LAW.values()))
TERMS = ("C_A", "C_B", "C_G")
TRUTH = {"K_tau": K_TAU, "K_tau0": K_TAU0} | LAW | {"P_0": float(law(LAWFUL.law, -CENTRE[0], -CENTRE[1]))}


def study(seeds: range, drives: Drives) -> dict[str, tuple[float, float]]:
    """Share of flights whose interval holds the truth, and median relative error, by an estimate's name."""
    found: dict[str, list[Estimate]] = {}
    for seed in seeds:
        data = simulated(drives._replace(seed=seed, course=True))
        for estimate in (*identify_torque(data).estimates, *identify_power(data, *CENTRE, TERMS).estimates):
            found.setdefault(estimate.name, []).append(estimate)
    return {
        name: (
            float(np.mean([e.contains(TRUTH[name]) for e in rows])),
            float(np.median([abs(e.value / TRUTH[name] - 1) for e in rows])),
        )
        for name, rows in found.items()
    }


def test_constants_lie_within_their_intervals() -> None:
    shares = study(range(12), LAWFUL)
    assert set(shares) == {"K_tau", "K_tau0", "P_0", *TERMS}
    assert np.mean([share for share, _ in shares.values()]) >= 0.85


@pytest.mark.validate
@pytest.mark.parametrize("duration", [25.0, 60.0])
def test_constants_lie_within_their_intervals_over_many_flights(duration: float) -> None:
    """The promise: 90 to 98 % of the intervals of each constant, and medians within 2 %."""
    found = study(SEEDS, LAWFUL._replace(duration=duration))
    medians = {name: error for name, (_, error) in found.items()}
    told = ", ".join(f"{name} {100 * error:.2f} %" for name, error in medians.items())
    print(f"drive, {duration:.0f} s, median errors: {told}")  # noqa: T201
    promise_kept(f"drive, {duration:.0f} s", {name: share for name, (share, _) in found.items()})
    assert max(medians.values()) < 0.02


def test_gauges_that_lag_are_found_out() -> None:
    data = simulated(SHORT)
    late = by_name(identify_torque(data._replace(torque_time=data.torque_time + 0.0025)))
    assert late["K_tau"].value == pytest.approx(K_TAU, rel=0.005)
    assert late["K_tau0"].value == pytest.approx(K_TAU0, rel=0.005)


def test_what_calibrations_left_is_in_the_intervals() -> None:
    """A scale error shows in no residual: the gauges' accuracy must be told for an interval that holds the truth."""
    data = simulated(SHORT)
    wrong = data._replace(current=data.current * 1.01, torque_left=data.torque_left * 1.005)
    told = by_name(identify_torque(wrong, GaugeErrors(torque_scale=0.005, current_scale=0.01)))
    assert not by_name(identify_torque(wrong))["K_tau"].contains(K_TAU)
    assert told["K_tau"].contains(K_TAU)
    assert told["K_tau"].standard_error == pytest.approx(K_TAU * np.hypot(0.01, 0.005 / np.sqrt(2)), rel=0.15)


@pytest.mark.parametrize("sensor", ["torque_zero", "torque_scale", "current_zero", "current_scale"])
def test_sensitivity_to_a_sensor_is_that_of_fitting_again(sensor: str) -> None:
    """GUM 5.1.3: the deviation that a sensor adds is what one standard deviation of it moves the estimate by."""
    data, one = simulated(SHORT), 1e-4
    plain, told = by_name(identify_torque(data)), by_name(identify_torque(data, GaugeErrors(**{sensor: one})))
    name = "K_tau0" if sensor.endswith("zero") else "K_tau"
    added = math.sqrt(told[name].standard_error ** 2 - plain[name].standard_error ** 2)
    signals = ("torque_left", "torque_right") if sensor.startswith("torque") else ("current",)
    moved = []
    for signal in signals:
        values = getattr(data, signal)
        shifted = values + one if sensor.endswith("zero") else values * (1.0 + one)
        moved.append(by_name(identify_torque(data._replace(**{signal: shifted})))[name].value - plain[name].value)
    assert added == pytest.approx(math.hypot(*moved), rel=0.05)


def test_a_current_that_hardly_varies_between_strokes_gives_no_slope() -> None:
    model = identify_power(simulated(SHORT._replace(throttle=0.002, noise=10.0)))
    refused = {entry.subject: entry.text for entry in model.withheld}
    assert "little but noise" in refused["C_B"]
    assert set(by_name(model)) == {"P_0"}


def test_without_a_slope_over_the_current_the_constant_of_eq_12_is_refused() -> None:
    """It is the power at no current: where the slope is lost it was the power at the centre, printed twice."""
    model = identify_power(simulated(SHORT._replace(throttle=0.002, noise=10.0)))
    refused = {entry.subject: entry.text for entry in model.withheld}
    assert "without C_B" in refused["C_A"]
    data = measure(simulate(LAWFUL), LAWFUL)
    assert power_truth(data, model).keys() == {"P_0"}


def test_a_constant_whose_interval_spans_zero_is_refused() -> None:
    model = identify_power(simulated(SHORT._replace(law=(0.0, 3.3, 0.0, 0.0, 0.0, 0.0))))
    refused = {entry.subject: entry.text for entry in model.withheld}
    assert "spans zero" in refused["C_A"]
    assert {"P_0", "C_B"} <= set(by_name(model))


def test_what_the_calibrations_leave_too_wide_is_refused() -> None:
    data = simulated(SHORT._replace(law=(-0.05, 12.3, 0.0, 0.0, 3.4, 0.0), duration=15.0))
    exact_gauges, poor = GaugeErrors(torque_scale=1e-9), GaugeErrors(current_scale=0.3, torque_scale=0.6)
    assert "C_G" in by_name(power_with_gauge_errors(data, exact_gauges))
    model = power_with_gauge_errors(data, poor)
    refused = {entry.subject: entry.text for entry in model.withheld}
    assert all(not found.contains(0.0) for found in model.estimates)
    assert "calibrations" in refused["C_G"]


def test_torque_constants_are_within_one_percent() -> None:
    found = by_name(identify_torque(simulated(SHORT)))
    assert found["K_tau"].value == pytest.approx(K_TAU, rel=0.01)
    assert found["K_tau0"].value == pytest.approx(K_TAU0, rel=0.01)
    assert found["K_tau"].high - found["K_tau"].low < 0.02 * K_TAU


def test_stroke_means_would_be_biased_by_the_floor() -> None:
    """Why the fit is on single samples: the means of torque and current lie off the line."""
    data = simulated(SHORT)
    torque = (np.abs(data.torque_left) + np.abs(data.torque_right)).mean() / 2
    assert abs(torque - (K_TAU * data.current.mean() + K_TAU0)) > 0.03


def test_current_noise_does_not_flatten_the_slope() -> None:
    found = by_name(identify_torque(simulated(SHORT._replace(noise=6.0))))
    assert found["K_tau"].value == pytest.approx(K_TAU, rel=0.03)


def test_power_coefficients_hold_the_truth_of_the_noise_free_regression() -> None:
    inside = total = 0
    for seed in range(20):
        drives = SHORT._replace(seed=seed)
        world = simulate(drives)
        model = identify_power(measure(world, drives))
        truth = power_truth(exact(world), model)
        inside += sum(estimate.contains(truth[estimate.name]) for estimate in model.estimates)
        total += len(model.estimates)
    assert total >= 40
    assert inside >= 0.9 * total


def test_mean_power_is_within_two_percent() -> None:
    world = simulate(SHORT)
    found = by_name(identify_power(measure(world, SHORT)))
    power = (world.torque * world.rate).sum(axis=0).mean() / 2
    assert found["P_0"].value == pytest.approx(power, rel=0.02)


def test_voltage_that_only_sags_with_the_current_is_refused_with_the_reason() -> None:
    model = identify_power(simulated(Drives(noise=0.2)))
    refused = {entry.subject: entry.text for entry in model.withheld}
    assert "voltage follows the other terms" in refused["C_C"]
    assert "C_B" in by_name(model)
    assert not {"C_C", "C_F", "C_H"} & set(by_name(model))


def test_a_voltage_that_matters_on_its_own_is_identified() -> None:
    drives = Drives(wander=0.4)
    data = simulated(drives)
    stronger = data._replace(
        rate_left=data.rate_left * np.interp(data.wing_time, data.power_time, data.voltage) / 8,
        rate_right=data.rate_right * np.interp(data.wing_time, data.power_time, data.voltage) / 8,
    )
    found = by_name(identify_power(stronger))
    assert found["C_C"].low > 0


def test_given_centres_are_used() -> None:
    model = identify_power(simulated(SHORT), -0.936, -6.877)
    assert (model.fixed["C_D"], model.fixed["C_E"]) == (-0.936, -6.877)


def test_centring_moves_only_the_description() -> None:
    """The same terms about another centre are the same polynomial."""
    data = simulated(SHORT)
    terms = ("C_A", "C_B", "C_G")

    def value(model: EstimationResult, current: float) -> float:
        c = {e.name: e.value for e in model.estimates}
        return c["C_A"] + c["C_B"] * current + c["C_G"] * (current + model.fixed["C_D"]) ** 2

    one, other = identify_power(data, terms=terms), identify_power(data, -0.3, -7.0, terms)
    assert value(one, 0.9) == pytest.approx(value(other, 0.9), rel=1e-9)


def test_wings_at_rest_are_refused() -> None:
    data = simulated(SHORT)
    still = data._replace(
        current=np.full_like(data.current, 0.16),
        torque_left=np.zeros_like(data.torque_left),
        torque_right=np.zeros_like(data.torque_right),
        strokes=np.zeros_like(data.strokes),
    )
    with pytest.raises(InputError, match="current does not vary"):
        identify_torque(still)
    with pytest.raises(InputError, match="0 wing strokes"):
        identify_power(still)


def test_torque_that_has_nothing_to_do_with_the_current_gives_no_constant() -> None:
    data = simulated(SHORT)
    rng = np.random.default_rng(1)
    constant = 0.9 + 0.02 * rng.normal(size=(2, len(data.torque_time)))  # loaded, and blind to the current
    model = identify_torque(data._replace(torque_left=constant[0], torque_right=constant[1]))
    assert model.estimates == ()
    assert "does not follow" in model.withheld[0].text
