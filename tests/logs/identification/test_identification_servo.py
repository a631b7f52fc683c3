"""Torque and power models of drives with known constants, measured as the flight computer does."""

from __future__ import annotations

import numpy as np
import pytest
from wing_drives import K_TAU, K_TAU0, Drives, exact, measure, simulate

from avionics.quantities import BadInput
from logs.identification.data import DriveData
from logs.identification.drive.servo import ServoModel, identify_power, identify_torque, power_truth
from logs.identification.results import Estimate

SHORT = Drives(duration=25.0)


def flown(drives: Drives) -> DriveData:
    return measure(simulate(drives), drives)


def by_name(model: ServoModel) -> dict[str, Estimate]:
    return {estimate.name: estimate for estimate in model.estimates}


def torque_covered(seeds: range, drives: Drives) -> tuple[int, int]:
    models = [by_name(identify_torque(flown(drives._replace(seed=seed)))) for seed in seeds]
    return (
        sum(model["K_tau"].contains(K_TAU) for model in models),
        sum(model["K_tau0"].contains(K_TAU0) for model in models),
    )


def test_torque_constants_lie_within_their_intervals() -> None:
    slope, offset = torque_covered(range(20), SHORT)
    assert slope >= 17
    assert offset >= 17


@pytest.mark.validate
def test_torque_constants_lie_within_their_intervals_over_many_flights() -> None:
    slope, offset = torque_covered(range(300), SHORT)
    assert slope >= 264
    assert offset >= 264


def test_torque_constants_are_within_one_percent() -> None:
    found = by_name(identify_torque(flown(SHORT)))
    assert found["K_tau"].value == pytest.approx(K_TAU, rel=0.01)
    assert found["K_tau0"].value == pytest.approx(K_TAU0, rel=0.01)
    assert found["K_tau"].high - found["K_tau"].low < 0.02 * K_TAU


def test_stroke_means_would_be_biased_by_the_floor() -> None:
    """Why the fit is on single samples: the means of torque and current lie off the line."""
    data = flown(SHORT)
    torque = (np.abs(data.torque_left) + np.abs(data.torque_right)).mean() / 2
    assert abs(torque - (K_TAU * data.current.mean() + K_TAU0)) > 0.03


def test_current_noise_does_not_flatten_the_slope() -> None:
    found = by_name(identify_torque(flown(SHORT._replace(noise=6.0))))
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
    model = identify_power(flown(Drives(noise=0.2)))
    refused = {entry.name: entry.reason for entry in model.unidentified}
    assert "voltage follows the other terms" in refused["C_C"]
    assert "C_B" in by_name(model)
    assert not {"C_C", "C_F", "C_H"} & set(by_name(model))


def test_a_voltage_that_matters_on_its_own_is_identified() -> None:
    drives = Drives(wander=0.4)
    data = flown(drives)
    stronger = data._replace(
        rate_left=data.rate_left * np.interp(data.wing_time, data.power_time, data.voltage) / 8,
        rate_right=data.rate_right * np.interp(data.wing_time, data.power_time, data.voltage) / 8,
    )
    found = by_name(identify_power(stronger))
    assert found["C_C"].low > 0


def test_given_centres_are_used() -> None:
    model = identify_power(flown(SHORT), -0.936, -6.877)
    assert (model.centre_current, model.centre_voltage) == (-0.936, -6.877)


def test_centring_moves_only_the_description() -> None:
    """The same terms about another centre are the same polynomial."""
    data = flown(SHORT)
    terms = ("C_A", "C_B", "C_G")

    def value(model: ServoModel, current: float) -> float:
        c = {e.name: e.value for e in model.estimates}
        return c["C_A"] + c["C_B"] * current + c["C_G"] * (current + model.centre_current) ** 2

    one, other = identify_power(data, terms=terms), identify_power(data, -0.3, -7.0, terms)
    assert value(one, 0.9) == pytest.approx(value(other, 0.9), rel=1e-9)


def test_wings_at_rest_are_refused() -> None:
    data = flown(SHORT)
    still = data._replace(
        current=np.full_like(data.current, 0.16),
        torque_left=np.zeros_like(data.torque_left),
        torque_right=np.zeros_like(data.torque_right),
        strokes=np.zeros_like(data.strokes),
    )
    with pytest.raises(BadInput, match="current does not vary"):
        identify_torque(still)
    with pytest.raises(BadInput, match="0 wing strokes"):
        identify_power(still)


def test_torque_that_has_nothing_to_do_with_the_current_gives_no_constant() -> None:
    data = flown(SHORT)
    rng = np.random.default_rng(1)
    constant = 0.9 + 0.02 * rng.normal(size=(2, len(data.torque_time)))  # loaded, and blind to the current
    model = identify_torque(data._replace(torque_left=constant[0], torque_right=constant[1]))
    assert model.estimates == ()
    assert "does not follow" in model.unidentified[0].reason
