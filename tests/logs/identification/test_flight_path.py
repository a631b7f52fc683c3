"""Reconstruction of a prescribed flight: errors of the sensors inside their intervals, findings for what is not."""

from __future__ import annotations

import numpy as np
import pytest
from prescribed_flight import ERRORS, NOISE, PLACES, Flight, measured, truth
from promised import SEEDS, promise_kept

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.flight_path import METHOD, FlightPath, PathOptions, reconstruct
from logs.identification.estimators.registry import ESTIMATORS, Request
from logs.identification.models.rigid_body import SensorPositions
from logs.identification.results import Array
from wingbeat.errors import InputError

LONGITUDINAL = ("airspeed", "theta", "altitude")
LONGITUDINAL_FLOW = ("airspeed", "alpha", "theta", "altitude")


def reconstructed(flight: Flight, channels: tuple[str, ...] = (), **options: object) -> FlightPath:
    settings = PathOptions(longitudinal=flight.longitudinal, positions=flight.places)._replace(**options)
    return reconstruct([measured(flight, channels)], settings)


def codes(path: FlightPath) -> dict[str, set[str]]:
    """Subjects by code."""
    table: dict[str, set[str]] = {}
    for one in path.result.findings:
        table.setdefault(one.code, set()).add(one.subject)
        assert one.text
    return table


def changed(flight: Flight, **signals: Array) -> FlightPath:
    """Of a flight with other signals."""
    experiment = measured(flight)
    experiment = experiment._replace(signals={**experiment.signals, **signals})
    return reconstruct([experiment], PathOptions(positions=flight.places))


@pytest.fixture(scope="module")
def noisy() -> FlightPath:
    return reconstructed(Flight(seed=1))


def test_without_noise_all_errors_are_exact() -> None:
    """GIVEN sensors on arms, biases and scales, a wind and no noise THEN only what the sampling loses is left."""
    errors = {**ERRORS, "scale_q": 0.02, "bias_psi": 0.0}
    path = reconstructed(Flight(noise=0, input_noise=0, errors=errors, wind=(2.0, -1.0)), also=("scale_q",))
    values = {one.name: one.value for one in path.result.estimates}
    assert values.keys() == {*ERRORS, "scale_q", "wind_north", "wind_east"}
    for name, value in values.items():
        assert value == pytest.approx({**errors, "wind_north": 2.0, "wind_east": -1.0}[name], abs=1e-5)


def test_with_noise_the_errors_lie_within_their_intervals(noisy: FlightPath) -> None:
    truths = {**ERRORS, "wind_north": 0.0, "wind_east": 0.0}
    scores = [(one.value - truths[one.name]) / one.standard_error for one in noisy.result.estimates]
    assert len(scores) == 12
    assert np.max(np.abs(scores)) < 3.5
    assert np.sum([one.contains(truths[one.name]) for one in noisy.result.estimates]) >= 10
    assert noisy.result.correlation is not None
    np.testing.assert_allclose(np.diag(noisy.result.correlation), 1.0)


def test_motion_is_that_of_the_center_of_mass(noisy: FlightPath) -> None:
    _, true = truth(Flight(seed=1, places=SensorPositions()))
    (motion,) = noisy.motions
    for name, error in {"airspeed": 0.05, "alpha": 0.003, "beta": 0.003, "theta": 0.002, "phi": 0.002}.items():
        assert np.sqrt(np.mean((motion.signals[name] - true[name]) ** 2)) < error
    assert motion.units["alpha"] == "rad"


def test_residuals_are_the_noise(noisy: FlightPath) -> None:
    assert len(noisy.result.series) == 10
    for one in noisy.result.series:
        assert np.std(one.measured - one.model) == pytest.approx(NOISE[one.output], rel=0.1)


def test_missing_channels_are_findings() -> None:
    path = reconstructed(Flight(seed=3), ("airspeed", "alpha", "phi", "theta", "psi", "altitude"))
    lost = {one.subject: one.text for one in path.result.withheld}
    assert lost["bias_beta"] == "beta not measured"
    assert lost["wind_north"] == "north and east not measured"
    assert {"bias_p", "bias_q", "bias_a_x", "bias_alpha"} <= {one.name for one in path.result.estimates}


@pytest.mark.parametrize(("seed", "duration"), [(0, 20.0), (2, 30.0)])
def test_without_an_attitude_gravity_comes_from_the_flow(seed: int, duration: float) -> None:
    """GIVEN no attitude, and a flight that does not begin with level wings THEN all errors are found."""
    flight = Flight(seed=seed, duration=duration)
    path = reconstructed(flight, ("airspeed", "alpha", "beta", "altitude"))
    assert {one.name for one in path.result.estimates} == ERRORS.keys()
    assert all(abs(one.value - ERRORS[one.name]) < 3 * one.standard_error for one in path.result.estimates)
    _, true = truth(flight)
    for angle in ("phi", "theta"):
        assert np.std(path.motions[0].signals[angle] - true[angle]) < 0.01


def test_missing_samples_of_outputs_are_left_out() -> None:
    flight = Flight(seed=4, longitudinal=True)
    experiment = measured(flight, LONGITUDINAL)
    sparse = dict(experiment.signals)
    sparse["airspeed"] = np.where(np.arange(len(experiment.time)) % 4 == 0, sparse["airspeed"], np.nan)
    sparse["theta"] = np.where((experiment.time > 5) & (experiment.time < 8), np.nan, sparse["theta"])
    options = PathOptions(longitudinal=True, positions=flight.places)
    path = reconstruct([experiment._replace(signals=sparse)], options)
    for one in path.result.estimates:
        assert abs(one.value - ERRORS[one.name]) < 4 * one.standard_error
    theta = next(one for one in path.result.series if one.output == "theta")
    assert np.isnan(theta.measured).sum() == pytest.approx(150, abs=2)


def test_what_is_not_identifiable_is_withheld() -> None:
    """GIVEN heading measured without position THEN its bias is that of the initial heading."""
    path = reconstructed(Flight(seed=5), ("airspeed", "alpha", "beta", "phi", "theta", "psi"), also=("bias_psi",))
    assert codes(path)["not_identifiable"] == {"bias_psi"}
    assert "bias_p" in {one.name for one in path.result.estimates}
    altitude = reconstructed(Flight(seed=5, longitudinal=True), LONGITUDINAL, also=("bias_altitude", "bias_color"))
    assert codes(altitude)["not_identifiable"] == {"bias_altitude"}
    assert codes(altitude)["unknown_error"] == {"bias_color"}


def test_errors_that_the_motion_hardly_excites_are_marked() -> None:
    """GIVEN flight that is all but steady THEN a vane's scale has a wide interval, which contains it."""
    flight = Flight(seed=6, activity=0.01, longitudinal=True)
    path = reconstructed(flight, LONGITUDINAL_FLOW)
    assert codes(path)["imprecise"] == {"scale_alpha"}
    assert all(one.contains(ERRORS[one.name]) for one in path.result.estimates)


def test_joint_intervals_of_quiet_flight_contain_the_truth() -> None:
    """GIVEN flight too quiet for the vane's scale THEN the intervals of what depends on it contain the truth."""
    inside = []
    for seed in range(8):
        path = reconstructed(Flight(seed=seed, activity=0.02, step=0.05, longitudinal=True), LONGITUDINAL_FLOW)
        inside += [one.contains(ERRORS[one.name]) for one in path.result.estimates]
    assert np.mean(inside) >= 0.88


@pytest.mark.parametrize("factor", [1 / 3.6, 3600 / 1852])
def test_an_airspeed_in_another_unit_is_incompatible(factor: float) -> None:
    flight = Flight(seed=0, duration=15, step=0.04)
    path = changed(flight, airspeed=measured(flight).signals["airspeed"] * factor)
    assert codes(path)["incompatible_signals"]
    assert "incompatible_signals" not in codes(reconstructed(flight))


@pytest.mark.parametrize(
    ("seed", "step", "duration"),
    [
        (0, 0.04, 15),
        pytest.param(0, 0.04, 60, marks=pytest.mark.validate),
        pytest.param(1, 0.04, 60, marks=pytest.mark.validate),
        pytest.param(3, 0.02, 60, marks=pytest.mark.validate),
    ],
)
def test_a_vane_of_the_wrong_sign_is_incompatible(seed: int, step: float, duration: float) -> None:
    """GIVEN up to a minute, over which integrated noise of the inputs adds to the residuals."""
    flight = Flight(seed=seed, duration=duration, step=step)
    path = changed(flight, beta=-measured(flight).signals["beta"])
    assert codes(path)["incompatible_signals"] == {"beta"}
    assert codes(path)["at_bound"] == {"scale_beta"}


@pytest.mark.parametrize(
    ("duration", "step"),
    [
        (15, 0.02),
        pytest.param(60, 0.02, marks=pytest.mark.validate),
        pytest.param(60, 0.04, marks=pytest.mark.validate),
        pytest.param(120, 0.04, marks=pytest.mark.validate),
    ],
)
def test_consistent_records_of_any_length_have_no_warnings(duration: float, step: float) -> None:
    path = reconstructed(Flight(seed=5, duration=duration, step=step))
    assert not path.result.warnings
    assert {one.name for one in path.result.estimates} >= ERRORS.keys()


def test_several_records_share_the_sensors() -> None:
    flights = [Flight(seed=seed, duration=8, longitudinal=True) for seed in (7, 8, 9)]
    options = PathOptions(longitudinal=True, positions=PLACES)
    joint = reconstruct([measured(flight, LONGITUDINAL) for flight in flights], options)
    single = reconstruct([measured(flights[0], LONGITUDINAL)], options)
    assert len(joint.motions) == 3
    for all_, one in zip(joint.result.estimates, single.result.estimates, strict=True):
        assert all_.standard_error < 0.8 * one.standard_error
        assert abs(all_.value - ERRORS[all_.name]) < 4 * all_.standard_error


def test_bad_records_are_refused_in_a_line() -> None:
    experiment = measured(Flight(longitudinal=True), LONGITUDINAL)

    def without(name: str) -> Experiment:
        return experiment._replace(signals={k: v for k, v in experiment.signals.items() if k != name})

    options = PathOptions(longitudinal=True)
    with pytest.raises(InputError, match="q was not measured"):
        reconstruct([without("q")], options)
    with pytest.raises(InputError, match="airspeed was not measured"):
        reconstruct([without("airspeed")], options)
    gap = np.where(np.arange(len(experiment.time)) == 50, np.nan, experiment.signals["a_z"])
    with pytest.raises(InputError, match="a_z lacks 1 samples"):
        reconstruct([experiment._replace(signals={**experiment.signals, "a_z": gap})], options)
    with pytest.raises(InputError, match="not equally spaced"):
        reconstruct([experiment._replace(time=experiment.time**1.1)], options)
    with pytest.raises(InputError, match="banked turns"):
        reconstruct([measured(Flight())], options)
    with pytest.raises(InputError, match="no record"):
        reconstruct([], options)


def test_rates_in_degrees_are_incompatible() -> None:
    experiment = measured(Flight(longitudinal=True, duration=5.0), LONGITUDINAL)
    wrong = {**experiment.signals, "q": np.degrees(experiment.signals["q"])}
    options = PathOptions(longitudinal=True, positions=PLACES)
    path = reconstruct([experiment._replace(signals=wrong)], options)
    assert "theta" in codes(path)["incompatible_signals"]


def test_the_registry_predicts_held_out_records() -> None:
    flights = [measured(Flight(seed=seed, duration=12, longitudinal=True), LONGITUDINAL_FLOW) for seed in (1, 2)]
    options = {"longitudinal": True, "positions": PLACES}
    result = ESTIMATORS[METHOD].estimate(Request((flights[0],), (flights[1],), options=options))
    predicted = [one for one in result.series if one.held_out]
    assert {one.output for one in predicted} == set(LONGITUDINAL_FLOW)
    for one in predicted:
        bias = ERRORS.get(f"bias_{one.output}", 0.0)
        assert np.std(one.measured - one.model) < 1.5 * NOISE[one.output], (one.output, bias)


def coverage(seeds: range, flight: Flight, channels: tuple[str, ...]) -> dict[str, float]:
    """Fraction of intervals that contain the truth, by parameter."""
    hits: dict[str, list[bool]] = {}
    for seed in seeds:
        path = reconstructed(flight._replace(seed=seed), channels)
        assert path.result.status == "converged"
        for estimate in path.result.estimates:
            hits.setdefault(estimate.name, []).append(estimate.contains(flight.errors.get(estimate.name, 0.0)))
    return {name: float(np.mean(inside)) for name, inside in hits.items()}


@pytest.mark.parametrize("colour", [0.0, pytest.param(0.9, marks=pytest.mark.validate)])
def test_intervals_contain_the_truth(colour: float) -> None:
    shares = coverage(range(6), Flight(longitudinal=True, colour=colour), LONGITUDINAL)
    assert np.mean(list(shares.values())) >= 0.8


@pytest.mark.validate
@pytest.mark.parametrize("input_noise", [0.0, 1.0])
@pytest.mark.parametrize("colour", [0.0, 0.9])
@pytest.mark.parametrize("longitudinal", [True, False])
def test_intervals_of_many(longitudinal: bool, colour: float, input_noise: float) -> None:
    flight = Flight(longitudinal=longitudinal, colour=colour, input_noise=input_noise)
    shares = coverage(SEEDS, flight, LONGITUDINAL if longitudinal else ())
    promise_kept(f"flight path, longitudinal {longitudinal}, colour {colour}, input noise {input_noise}", shares)
