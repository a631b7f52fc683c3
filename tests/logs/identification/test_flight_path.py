"""Reconstruction of a prescribed flight: sensors' errors are found within their intervals, or it is said why not."""

from __future__ import annotations

import numpy as np
import pytest
from prescribed_flight import ERRORS, NOISE, PLACES, Flight, measured, truth
from promised import SEEDS, promise_kept

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.flight_path import reconstruction as flight_path
from logs.identification.estimators.flight_path.decimation import thinned, windows_of
from logs.identification.estimators.flight_path.initial_values import starts_of
from logs.identification.estimators.flight_path.reconstruction import Reconstruction, Setup, reconstruct
from logs.identification.estimators.flight_path.records import Problem, free_states, path_of, records_of
from logs.identification.estimators.flight_path.sensors import Parameter, Places
from wingbeat.errors import InputError

LONGITUDINAL = ("airspeed", "theta", "altitude")
LONGITUDINAL_FLOW = ("airspeed", "alpha", "theta", "altitude")


def rebuilt(flight: Flight, channels: tuple[str, ...] = (), **asked: object) -> Reconstruction:
    setup = Setup(longitudinal=flight.longitudinal, places=flight.places)._replace(**asked)
    return reconstruct([measured(flight, channels)], setup)


def reasons(found: Reconstruction) -> dict[str, str]:
    return {refused.name: refused.reason for refused in found.unidentified}


@pytest.fixture(scope="module")
def noisy() -> Reconstruction:
    return rebuilt(Flight(seed=1))


def test_without_noise_all_errors_are_found_exactly() -> None:
    """GIVEN sensors on arms, biases and scales, a wind and no noise THEN only what the sampling loses is left."""
    errors = {**ERRORS, "scale_q": 0.02, "bias_psi": 0.0}
    found = rebuilt(Flight(noise=0, input_noise=0, errors=errors, wind=(2.0, -1.0)), also=("scale_q",))
    assert not found.failure
    values = {p.name: p.value for p in found.parameters}
    assert values.keys() == {*ERRORS, "scale_q", "wind_north", "wind_east"}
    for name, truth_ in {**errors, "wind_north": 2.0, "wind_east": -1.0}.items():
        if name in values:
            assert values[name] == pytest.approx(truth_, abs=1e-5)


def test_with_noise_the_errors_lie_within_their_intervals(noisy: Reconstruction) -> None:
    assert not noisy.failure
    truths = {**ERRORS, "wind_north": 0.0, "wind_east": 0.0}
    scores = [(p.value - truths[p.name]) / p.standard_error for p in noisy.parameters]
    assert len(scores) == 12
    assert np.max(np.abs(scores)) < 3.5
    assert np.sum([p.contains(truths[p.name]) for p in noisy.parameters]) >= 10
    np.testing.assert_allclose(np.diag(noisy.correlation), 1.0)


def test_the_motion_at_the_centre_of_mass_is_found(noisy: Reconstruction) -> None:
    flight = Flight(seed=1, places=Places())
    _, told = truth(flight)
    signals = noisy.tracks[0].motion.signals
    for name, error in {"airspeed": 0.05, "alpha": 0.003, "beta": 0.003, "theta": 0.002, "phi": 0.002}.items():
        assert np.sqrt(np.mean((signals[name] - told[name]) ** 2)) < error
    assert noisy.tracks[0].motion.units["alpha"] == "rad"


def test_residuals_are_the_noise_and_white(noisy: Reconstruction) -> None:
    assert len(noisy.tracks[0].whiteness) == 10
    for whiteness in noisy.tracks[0].whiteness:
        assert whiteness.deviation == pytest.approx(NOISE[whiteness.name], rel=0.1)
    assert np.mean([whiteness.outside for whiteness in noisy.tracks[0].whiteness]) < 0.12


def test_coloured_residuals_are_told() -> None:
    track = rebuilt(Flight(seed=2, colour=0.9, longitudinal=True), LONGITUDINAL).tracks[0]
    assert not any(whiteness.white for whiteness in track.whiteness)


def test_missing_channels_are_said_and_the_rest_is_found() -> None:
    found = rebuilt(Flight(seed=3), ("airspeed", "alpha", "phi", "theta", "psi", "altitude"))
    assert {"bias_beta", "scale_beta"} <= reasons(found).keys()
    assert reasons(found)["bias_beta"] == "beta was not measured"
    assert reasons(found)["wind_north"] == "north and east were not measured"
    assert {"bias_p", "bias_q", "bias_a_x", "bias_alpha"} <= {p.name for p in found.parameters}


@pytest.mark.parametrize(("seed", "duration"), [(0, 20.0), (2, 30.0)])
def test_without_an_attitude_gravity_is_found_from_the_flow(seed: int, duration: float) -> None:
    """GIVEN no attitude, and a flight that does not begin with level wings THEN the search starts near its own."""
    flight = Flight(seed=seed, duration=duration)
    found = rebuilt(flight, ("airspeed", "alpha", "beta", "altitude"))
    assert {p.name for p in found.parameters} == ERRORS.keys()
    assert all(abs(p.value - ERRORS[p.name]) < 3 * p.standard_error for p in found.parameters)
    _, told = truth(flight)
    for angle in ("phi", "theta"):
        assert np.std(found.tracks[0].motion.signals[angle] - told[angle]) < 0.01


def test_missing_samples_of_outputs_are_left_out() -> None:
    flight = Flight(seed=4, longitudinal=True)
    experiment = measured(flight, LONGITUDINAL)
    sparse = dict(experiment.signals)
    sparse["airspeed"] = np.where(np.arange(len(experiment.time)) % 4 == 0, sparse["airspeed"], np.nan)
    sparse["theta"] = np.where((experiment.time > 5) & (experiment.time < 8), np.nan, sparse["theta"])
    found = reconstruct([experiment._replace(signals=sparse)], Setup(longitudinal=True, places=flight.places))
    for estimate in found.parameters:
        assert abs(estimate.value - ERRORS[estimate.name]) < 4 * estimate.standard_error
    assert np.isnan(found.tracks[0].residuals["theta"]).sum() == pytest.approx(150, abs=2)


def test_what_cannot_be_told_apart_is_refused_by_name() -> None:
    """GIVEN heading measured without position THEN its bias is that of the first heading."""
    found = rebuilt(Flight(seed=5), ("airspeed", "alpha", "beta", "phi", "theta", "psi"), also=("bias_psi",))
    assert "psi at the start" in reasons(found)["bias_psi"]
    assert not found.failure
    altitude = rebuilt(Flight(seed=5, longitudinal=True), LONGITUDINAL, also=("bias_altitude", "bias_colour"))
    assert "altitude at the start" in reasons(altitude)["bias_altitude"]
    assert reasons(altitude)["bias_colour"] == "no such error is modelled"


def test_what_the_motion_hardly_tells_is_refused_with_its_error() -> None:
    """GIVEN flight that is all but steady THEN a vane's scale is not told."""
    found = rebuilt(Flight(seed=6, activity=0.01, longitudinal=True), ("airspeed", "alpha", "theta", "altitude"))
    assert "standard error" in reasons(found)["scale_alpha"]
    assert "bias_q" in {p.name for p in found.parameters}


def test_what_errors_of_the_kinematics_make_of_a_vane_is_no_scale() -> None:
    """GIVEN a vane that hardly moved, and an accelerometer that wandered THEN its scale is not called -0.7.

    Such signals are at odds too, so no number is told in the end.
    """
    flight = Flight(seed=1, duration=6, activity=0.02, longitudinal=True, noise=0.05, input_noise=0.1)
    experiment = measured(flight, ("airspeed", "alpha", "theta", "altitude"))
    wander = experiment.signals["a_z"] + 0.1 * np.sin(1.5 * experiment.time + 1)
    experiment = experiment._replace(signals={**experiment.signals, "a_z": wander})
    setup = Setup(longitudinal=True, places=flight.places)
    assert "follow alpha worse than a constant" in reconstruct([experiment], setup).failure
    found = reconstruct([experiment], setup._replace(gusts=True))
    assert "alpha would read next to nothing" in reasons(found)["scale_alpha"]
    (bias,) = (p for p in found.parameters if p.name == "bias_alpha")
    # The scale held at zero is missed in it, and no more: 0.08 of 0.08 rad. The interval knows.
    assert bias.contains(ERRORS["bias_alpha"])
    assert bias.value == pytest.approx(ERRORS["bias_alpha"] + 0.08 * 0.08, abs=0.004)


def test_intervals_know_what_is_held_at_zero() -> None:
    """GIVEN flight too quiet for the vanes' scales, which are not zero THEN what rests on them has them in it."""
    held = total = 0
    for seed in range(3):
        found = rebuilt(Flight(seed=seed, activity=0.02, step=0.05, longitudinal=True), LONGITUDINAL_FLOW)
        assert "scale_alpha" in reasons(found)
        held += sum(p.contains(ERRORS[p.name]) for p in found.parameters)
        total += len(found.parameters)
    assert held >= total - 1


def test_what_rests_on_errors_held_at_zero_alone_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a bias of alpha that its scale, not told, makes vaguer than a vane is wrong THEN it is refused."""
    asked = {"scale_alpha": 3.0, "bias_alpha": 0.1}
    known = flight_path.parameter

    def limited(name: str) -> Parameter | None:
        found = known(name)
        return found._replace(limit=asked[name]) if found is not None and name in asked else found

    monkeypatch.setattr(flight_path, "parameter", limited)
    flight = Flight(seed=6, activity=0.0005, step=0.05, longitudinal=True)
    found = rebuilt(flight, LONGITUDINAL_FLOW)
    assert "read next to nothing" in reasons(found)["scale_alpha"]
    assert reasons(found)["bias_alpha"].startswith("it rests on errors held at zero")
    assert len(found.correlation) == len(found.parameters) == 3


@pytest.mark.parametrize(("times", "unit"), [(1 / 3.6, "in m/s, not in km/h"), (3600 / 1852, "in kn, not in m/s")])
def test_an_airspeed_in_another_unit_is_found_out(times: float, unit: str) -> None:
    """GIVEN km/h or knots that are none THEN no vane reads nothing, but the unit is doubted."""
    flight = Flight(seed=0, duration=15, step=0.04)
    experiment = measured(flight)
    signals = {**experiment.signals, "airspeed": experiment.signals["airspeed"] * times}
    found = reconstruct([experiment._replace(signals=signals)], Setup(places=flight.places))
    assert found.failure.endswith(f"V is {times:.2g} times what all others say: is it {unit}?")
    assert not reconstruct([experiment], Setup(places=flight.places)).failure


def test_a_vane_that_counts_to_the_other_side_contradicts() -> None:
    flight = Flight(seed=0, duration=15, step=0.04)
    experiment = measured(flight)
    signals = {**experiment.signals, "beta": -experiment.signals["beta"]}
    found = reconstruct([experiment._replace(signals=signals)], Setup(places=flight.places))
    assert "beta would read backwards" in reasons(found)["scale_beta"]
    assert found.failure.startswith("the kinematics follow beta worse than a constant would")


@pytest.mark.parametrize(("seed", "step"), [(0, 0.04), (1, 0.04), (2, 0.04), (3, 0.02), (4, 0.02)])
def test_a_vane_that_counts_to_the_other_side_contradicts_in_long_records(seed: int, step: float) -> None:
    """GIVEN a minute, over which the noise of the inputs would hide what beta tells THEN no numbers all the same."""
    flight = Flight(seed=seed, duration=60, step=step)
    experiment = measured(flight)
    signals = {**experiment.signals, "beta": -experiment.signals["beta"]}
    found = reconstruct([experiment._replace(signals=signals)], Setup(places=flight.places))
    assert found.failure.startswith("the kinematics follow beta worse than a constant would")
    assert not found.parameters and not found.tracks


@pytest.mark.parametrize(("duration", "step"), [(15, 0.02), (60, 0.02), (60, 0.04), (120, 0.04)])
def test_records_of_any_length_that_are_right_are_believed(duration: float, step: float) -> None:
    found = rebuilt(Flight(seed=5, duration=duration, step=step))
    assert not found.failure
    assert {p.name for p in found.parameters} >= ERRORS.keys()


def test_thinned_records_are_means_of_what_was_measured() -> None:
    experiment = measured(Flight(duration=60, longitudinal=True), LONGITUDINAL)
    count = len(experiment.time)
    sparse = np.where(np.arange(count) % 20 == 0, experiment.signals["altitude"], np.nan)
    records, channels = records_of([experiment._replace(signals={**experiment.signals, "altitude": sparse})], True)
    (one,) = thinned(Problem(records, channels, (), free_states(channels, True), PLACES)).records
    assert one.step == pytest.approx(0.1) and len(one.time) == count // 5
    np.testing.assert_allclose(one.inputs[3], records[0].inputs[15:20].mean(axis=0))
    np.testing.assert_allclose(one.time[3], records[0].time[17])
    at = channels.index("altitude")
    np.testing.assert_array_equal(np.flatnonzero(one.used[:, at]), np.arange(0, count // 5, 4))
    np.testing.assert_array_equal(one.outputs[4, at], sparse[20])


def test_windows_begin_where_the_path_passes_and_miss_no_output() -> None:
    """GIVEN a minute THEN four pieces, fewer where the altitude was measured in a part of it alone."""
    experiment = measured(Flight(duration=60, longitudinal=True), LONGITUDINAL)
    for until, pieces in ((np.inf, 4), (44.0, 3), (35.0, 2), (20.0, 1)):
        altitude = np.where(experiment.time < until, experiment.signals["altitude"], np.nan)
        told = experiment._replace(signals={**experiment.signals, "altitude": altitude})
        records, channels = records_of([told], True)
        problem = Problem(records, channels, (), free_states(channels, True), PLACES)
        (start,) = starts_of(problem)[:1]
        path = path_of(problem, start, 0)
        short, values = windows_of(problem, start, [path])
        assert len(short.records) == pieces
        passed = np.searchsorted(experiment.time, [one.time[0] for one in short.records])
        np.testing.assert_array_equal(values.starts, path.states[passed])


@pytest.mark.parametrize("seed", [0, 1])
def test_noise_in_quiet_flight_is_no_contradiction(seed: int) -> None:
    """GIVEN motion that slow noise of the sensors hides THEN it is not said that they contradict one another."""
    flight = Flight(seed=seed, duration=8, activity=0.02, colour=0.9, step=0.05)
    assert not reconstruct([measured(flight)], Setup(places=flight.places)).failure


def test_several_records_share_the_sensors() -> None:
    flights = [Flight(seed=seed, duration=8, longitudinal=True) for seed in (7, 8, 9)]
    setup = Setup(longitudinal=True, places=PLACES)
    together = reconstruct([measured(flight, LONGITUDINAL) for flight in flights], setup)
    alone = reconstruct([measured(flights[0], LONGITUDINAL)], setup)
    assert len(together.tracks) == 3
    for joint, single in zip(together.parameters, alone.parameters, strict=True):
        assert joint.standard_error < 0.8 * single.standard_error
        assert abs(joint.value - ERRORS[joint.name]) < 4 * joint.standard_error


def test_bad_records_are_refused_in_a_line() -> None:
    experiment = measured(Flight(longitudinal=True), LONGITUDINAL)

    def without(name: str) -> Experiment:
        return experiment._replace(signals={k: v for k, v in experiment.signals.items() if k != name})

    setup = Setup(longitudinal=True)
    with pytest.raises(InputError, match="has no q"):
        reconstruct([without("q")], setup)
    with pytest.raises(InputError, match="no airspeed was measured"):
        reconstruct([without("airspeed")], setup)
    gap = np.where(np.arange(len(experiment.time)) == 50, np.nan, experiment.signals["a_z"])
    with pytest.raises(InputError, match="1 samples of a_z are missing"):
        reconstruct([experiment._replace(signals={**experiment.signals, "a_z": gap})], setup)
    with pytest.raises(InputError, match="not even"):
        reconstruct([experiment._replace(time=experiment.time**1.1)], setup)
    with pytest.raises(InputError, match="turns with banked wings"):
        reconstruct([measured(Flight())], setup)
    with pytest.raises(InputError, match="no record"):
        reconstruct([], setup)


def test_wrong_units_do_not_give_numbers() -> None:
    """GIVEN rates in degrees THEN no flight path fits, or one that is not believed."""
    experiment = measured(Flight(longitudinal=True, duration=5.0), LONGITUDINAL)
    wrong = {**experiment.signals, "q": np.degrees(experiment.signals["q"])}
    found = reconstruct([experiment._replace(signals=wrong)], Setup(longitudinal=True, places=PLACES))
    assert found.failure
    assert not found.parameters
    assert not found.tracks


def coverage(seeds: range, flight: Flight, channels: tuple[str, ...]) -> dict[str, float]:
    """Share of intervals that hold the truth, by parameter."""
    hits: dict[str, list[bool]] = {}
    for seed in seeds:
        found = rebuilt(flight._replace(seed=seed), channels)
        assert not found.failure
        for estimate in found.parameters:
            hits.setdefault(estimate.name, []).append(estimate.contains(flight.errors.get(estimate.name, 0.0)))
    return {name: float(np.mean(inside)) for name, inside in hits.items()}


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_intervals_hold_the_truth(colour: float) -> None:
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


def test_what_does_not_settle_is_told_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN no vane sideways THEN it is said that the airspeed alone tells how fast it flew sideways."""
    monkeypatch.setattr(flight_path, "fitted", lambda problem: None)
    blind = rebuilt(Flight(seed=1), ("airspeed", "phi", "theta", "psi", "altitude"))
    assert "did not converge: without beta" in blind.failure and "measure beta" in blind.failure
    assert rebuilt(Flight(seed=1, longitudinal=True), LONGITUDINAL).failure == "the reconstruction did not converge"
