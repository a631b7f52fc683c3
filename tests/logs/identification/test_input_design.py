"""Planned inputs: what they are predicted to leave uncertain is what many flights scatter by."""

from __future__ import annotations

import json
import math
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, REFERENCE, STEP, TRUTH, Flight, by_output_error, fly

from avionics.guidance.mission import Channel, Excitation, Shape
from avionics.missions.excitations import read_excitation
from groundstation.command import design, gcs_excite
from groundstation.command.gcs_session import VerbParser
from logs.identification.input_design.design import (
    DesignSpec,
    InputDesign,
    Limits,
    amplitude_factor,
    combined_error,
    command_line,
    design_input,
    mission_item,
    peaks,
)
from logs.identification.input_design.prediction import (
    Gust,
    Prior,
    predict,
    predicted_covariance,
    prior_of,
    respond,
    waveform,
)
from logs.identification.models.stroke_averaged import LONGITUDINAL
from logs.identification.results import Array
from sim_bridge.tuning.model import load_model
from wingbeat.errors import InputError

MODEL = Path(__file__).parents[2] / "data" / "models" / "robo_raven_ii_d.toml"
PRIOR = Prior(np.array([TRUTH[n] for n in LONGITUDINAL]), REFERENCE, AIRCRAFT, 0.25, (0.0066, 0.15, 0.15), STEP)
LIMITS = Limits(0.3, 0.4, 8.0, 0.15, 2.0)
DOUBLET = Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.15, 0.2, 1.2, 1)


def predicted(prior: Prior, requested: Excitation, repeats: int = 1, gust: Gust | None = None) -> dict[str, float]:
    planned = waveform(requested, prior.step, 1.0, prior.wing_period)
    covariance = predicted_covariance(prior, planned, respond(prior, planned), gust)
    return {one.name: one.standard_error for one in predict(prior, covariance, repeats)}


def scatter_over_prediction(flights: int, doublets: int) -> dict[str, float]:
    """Scatter of output error over many flights with white noise, as a share of what was predicted."""
    values: dict[str, list[float]] = {}
    for seed in range(flights):
        mode = by_output_error(fly(Flight(seed=seed, doublets=doublets, shaking=0.0)))
        assert mode.frequency is not None and mode.damping is not None
        for found in (mode.frequency, mode.damping, *mode.derivatives):
            values.setdefault(found.name, []).append(found.value)
    errors = predicted(PRIOR, DOUBLET, doublets)
    return {name: float(np.std(column, ddof=1)) / errors[name] for name, column in values.items()}


@pytest.mark.validate
def test_flights_scatter_as_predicted() -> None:
    ratios = scatter_over_prediction(10, 2)
    assert set(ratios) == set(predicted(PRIOR, DOUBLET))
    assert float(np.sqrt(np.mean(np.square(list(ratios.values()))))) == pytest.approx(1.0, abs=0.35)


@pytest.mark.validate
def test_flights_scatter_as_predicted_over_many_seeds() -> None:
    for name, ratio in scatter_over_prediction(300, 6).items():
        sys.stdout.write(f"{name}: scatter over 300 flights is {ratio:.2f} of the predicted standard error\n")
        assert ratio == pytest.approx(1.0, abs=0.2), name


def test_sensitivities_are_what_a_changed_derivative_does() -> None:
    planned = waveform(DOUBLET, STEP, 1.0, 0.25)
    response = respond(PRIOR, planned)
    for index, name in enumerate(LONGITUDINAL):
        width = np.zeros(12)
        width[index] = 1e-4
        ahead, behind = (respond(PRIOR._replace(values=PRIOR.values + s * width), planned).outputs for s in (1, -1))
        difference = (ahead - behind)[:, :3] / 2e-4
        scale = np.abs(difference).max()
        np.testing.assert_allclose(response.sensitivities[:, :, index], difference, atol=1e-5 * scale, err_msg=name)


def test_errors_fall_with_amplitude_and_repeats_and_rise_with_noise() -> None:
    one = predicted(PRIOR, DOUBLET)
    twice = predicted(PRIOR, DOUBLET._replace(amplitude=0.3))
    four = predicted(PRIOR, DOUBLET, repeats=4)
    noisy = predicted(PRIOR._replace(noise=(0.0132, 0.3, 0.3)), DOUBLET)
    for name, error in one.items():
        assert twice[name] == pytest.approx(error / 2, rel=1e-6)
        assert four[name] == pytest.approx(error / 2, rel=1e-6)
        assert noisy[name] == pytest.approx(error * 2, rel=1e-6)


def test_gusts_add_to_the_errors_and_by_their_strength() -> None:
    calm, light, strong = (predicted(PRIOR, DOUBLET, gust=gust) for gust in (None, Gust(0.5), Gust(2.0)))
    assert calm["short_period_frequency"] < light["short_period_frequency"] < strong["short_period_frequency"]
    assert strong["short_period_frequency"] == pytest.approx(4 * light["short_period_frequency"], rel=0.05)


def gusty_outputs(rng: np.random.Generator, prior: Prior, gust: Gust, count: int) -> Array:
    """q, a_x and a_z (N, 3) of the aircraft in first-order gusts along x and z, with sensor noise."""
    model, force = prior.model(), prior.values.reshape(3, 4)[:, :2]
    pole, fine = prior.reference.airspeed / gust.scale, 4
    dt = prior.step / fine
    lead = 4000
    draws = gust.sigma * np.sqrt(1 - np.exp(-2 * pole * dt)) * rng.normal(size=((count + lead) * fine, 2))
    x, air, rows = np.zeros(4), np.zeros(2), np.zeros((count + lead, 3))
    at_imu = np.array([np.zeros(2), force[0], force[1] - prior.aircraft.imu_x * force[2]])
    for k in range(len(rows)):
        rows[k] = (model.c @ x)[:3] - at_imu @ air
        for j in range(fine):
            x = x + dt * (model.a @ x - np.append(force @ air, 0.0))
            air = air * np.exp(-pole * dt) + draws[k * fine + j]
    return rows[lead:] + rng.normal(size=(count, 3)) * prior.noise


@pytest.mark.validate
def test_gusts_scatter_the_fit_as_predicted() -> None:
    """Least squares on the sensitivities, with the weights of the prediction, over gusts drawn in time."""
    prior, gust = PRIOR._replace(wing_period=0.0), Gust(0.3)
    planned = waveform(DOUBLET, STEP, 1.0, 0.25)
    response, count = respond(prior, planned), len(planned.time)
    rng = np.random.default_rng(1)
    drawn = [gusty_outputs(rng, prior, gust, count) for _ in range(120)]
    spread = np.sqrt(np.mean([np.mean(rows**2, axis=0) for rows in drawn], axis=0))
    columns = np.concatenate(
        (response.sensitivities, response.starts, np.broadcast_to(np.eye(3), (count, 3, 3))), axis=2
    )
    design_matrix = (columns / spread[:, None]).reshape(-1, columns.shape[2])
    solved = np.linalg.pinv(design_matrix) @ np.column_stack([(rows / spread).ravel() for rows in drawn])
    errors = np.sqrt(np.diag(predicted_covariance(prior, planned, response, gust)))
    ratios = np.std(solved[:12], axis=1) / errors
    sys.stdout.write(f"scatter in gusts over prediction: {np.round(ratios, 2)}\n")
    np.testing.assert_allclose(ratios, 1.0, atol=0.25)


@pytest.mark.parametrize("shape", list(Shape))
def test_an_input_goes_to_a_limit_and_not_beyond(shape: Shape) -> None:
    found = design_input(PRIOR, DesignSpec(shape, LIMITS))
    reached, limit = (np.array(changes) for changes in (found.reached, LIMITS))
    assert np.all(reached <= limit * 1.0001)
    assert getattr(found.reached, found.bound_by) > 0.9 * getattr(LIMITS, found.bound_by)


def test_the_time_unit_is_tuned_to_the_mode() -> None:
    """With a short pause: in a long one a slow mode is seen without an input of its period."""
    requested = DesignSpec(Shape.MULTISTEP_3211, LIMITS, settle=0.5)
    best = design_input(PRIOR, requested)
    slow = design_input(PRIOR._replace(values=PRIOR.values * np.where(np.arange(12) == 9, 0.3, 1.0)), requested)
    for width in (best.excitation.width / 2.5, best.excitation.width * 2.5):
        other = design_input(PRIOR, requested._replace(width=round(width, 2)))
        assert other.predicted[0].standard_error > best.predicted[0].standard_error
    assert slow.excitation.width > best.excitation.width


def test_repeats_reach_the_asked_error_and_no_more() -> None:
    requested = DesignSpec(Shape.DOUBLET, LIMITS, amplitude=0.05, width=0.2, frequency_error=2e-3)
    found = design_input(PRIOR, requested)
    frequency = found.predicted[0]
    one_less = design_input(PRIOR, requested._replace(repeats=found.excitation.repeats - 1)).predicted[0]
    assert found.excitation.repeats > 1
    assert frequency.standard_error <= 2e-3 * frequency.value < one_less.standard_error


def test_required_accuracy_uses_what_an_earlier_flight_left() -> None:
    """GIVEN required relative errors of M_delta and M_q, and standard errors of an earlier flight
    WHEN designed THEN both flights together meet them, one repeat fewer does not, and less is flown than without.
    """
    alone = DesignSpec(Shape.DOUBLET, LIMITS, amplitude=0.05, width=0.2, required={"M_delta": 0.004, "M_q": 0.01})
    left = {one.name: one.standard_error for one in design_input(PRIOR, alone._replace(repeats=3)).predicted}
    spec = alone._replace(known=left)
    found, without = design_input(PRIOR, spec), design_input(PRIOR, alone)
    assert 1 < found.excitation.repeats == without.excitation.repeats - 3
    fewer = design_input(PRIOR, spec._replace(repeats=found.excitation.repeats - 1))

    def excess(planned: InputDesign) -> float:
        rows = [one for one in planned.predicted if one.name in spec.required]
        return max(
            combined_error(one.standard_error, left[one.name]) / abs(one.value) / spec.required[one.name]
            for one in rows
        )

    assert excess(found) <= 1.0 + 1e-9 < excess(fewer)


def test_what_cannot_be_reached_is_refused() -> None:
    with pytest.raises(InputError, match="repeats, more than the 100"):
        design_input(PRIOR, DesignSpec(Shape.DOUBLET, LIMITS, amplitude=0.01, frequency_error=1e-6))
    with pytest.raises(InputError, match="outside"):
        design_input(PRIOR, DesignSpec(Shape.DOUBLET, Limits(elevator=1e-4)))
    with pytest.raises(InputError, match="above 0"):
        prior_of(load_model(MODEL), AIRCRAFT, (0.0, 0.1, 0.1))
    diverging = PRIOR._replace(values=PRIOR.values * np.where(np.arange(12) == 9, -1.0, 1.0))
    with pytest.raises(InputError, match=r"short period|grows by itself"):
        design_input(diverging, DesignSpec(Shape.DOUBLET, LIMITS, gust=Gust(1.0)))


def test_limits_bound_by_the_tightest() -> None:
    share, name = amplitude_factor(Limits(0.3, 0.4), Limits(0.1, 0.2, 1.0, 0.1, 0.5))
    assert (share, name) == (pytest.approx(2.0), "pitch")
    planned = waveform(DOUBLET, STEP, 1.0, 0.25)
    one = peaks(PRIOR, respond(PRIOR, planned), 0.15)
    assert one.elevator == 0.15
    assert all(value > 0 for value in one)


def test_a_prior_of_a_model_file_is_that_model() -> None:
    model = load_model(MODEL)
    prior = prior_of(model, AIRCRAFT, (0.01, 0.1, 0.1))
    np.testing.assert_allclose(prior.model().a[:3, :3], model.a[:3, :3], rtol=1e-6)
    np.testing.assert_allclose(prior.model().b, model.elevator, rtol=1e-6)


@pytest.mark.parametrize("shape", list(Shape))
def test_what_is_printed_flies_the_planned_input(shape: Shape) -> None:
    flown = design_input(
        PRIOR, DesignSpec(shape, LIMITS, width=0.3 if shape <= Shape.MULTISTEP_3211 else 10.0, repeats=3)
    ).excitation
    (item,) = tomllib.loads(mission_item(flown))["item"]
    read = read_excitation(item)
    words = command_line(flown).split()[3:]
    parser = VerbParser()
    gcs_excite.add_verbs(parser.add_subparsers(dest="verb"))
    typed = gcs_excite.excitation_of(parser.parse_args(words))
    for other in (read, typed):
        assert other.amplitude == pytest.approx(flown.amplitude, rel=1e-6)
        assert other._replace(amplitude=0.0) == flown._replace(amplitude=0.0)


def test_the_command_designs_from_a_model_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "excite.toml"
    assert design.run([str(MODEL), "--input", "doublet", "--repeats", "2", "--out", str(out), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {key for keys in design.JSON_KEYS for key in keys.split(", ")}
    assert [one["name"] for one in found["predicted"][:2]] == ["short_period_frequency", "short_period_damping"]
    assert all(one["standard_error"] > 0 for one in found["predicted"])
    assert tomllib.loads(out.read_text())["item"][0]["repeats"] == 2
    with pytest.raises(InputError, match="exists: it is not overwritten"):
        design.run([str(MODEL), "--out", str(out)])


IDENTIFIED = """
[identified]
log = "flight.mcap"
sha256 = ""
method = "output error"
elevator = 0.0
angle_of_attack = 0.1

[identified.estimates.M_delta]
value = 59.0
standard_error = 3.0
low = 53.0
high = 65.0
unit = "1/s^2"
"""


def test_the_command_adds_the_flight_of_the_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a log whose model has M_delta with an error of 5 % WHEN 1 % is wanted THEN both flights give it."""
    arguments: list[Path] = []

    def identified(source: Path, vehicle: str | None, path: Path) -> None:
        arguments.append(source)
        path.write_text(MODEL.read_text() + IDENTIFIED)

    monkeypatch.setattr(design, "write_identified", identified)
    log = tmp_path / "flight.mcap"
    log.write_bytes(b"")
    words = ["--from", str(log), "--want", "elevator,short_period", "--accuracy", "1", "--amplitude", "1"]
    assert design.run([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert arguments == [log]
    rows = {row["name"]: row for row in found["predicted"]}
    assert rows["M_delta"]["today"] == 3.0 and rows["M_q"]["today"] is None
    both = (1 / 3.0**2 + 1 / rows["M_delta"]["standard_error"] ** 2) ** -0.5
    assert rows["M_delta"]["together"] == pytest.approx(both)
    for name in ("M_delta", "short_period_frequency", "short_period_damping"):
        assert rows[name]["together"] <= 0.01 * abs(rows[name]["value"]) * (1.0 + 1e-9)
    assert design.run(words) == 0
    assert "today" in capsys.readouterr().out


def test_the_command_refuses_unclear_subjects() -> None:
    with pytest.raises(InputError, match="specify a MODEL or VEHICLE, or --from LOG"):
        design.run([])
    with pytest.raises(InputError, match="--accuracy goes with --want"):
        design.run([str(MODEL), "--accuracy", "5"])
    with pytest.raises(InputError, match="'rudder' is not one of elevator, short_period"):
        design.run([str(MODEL), "--want", "rudder"])


def test_the_command_shows_errors_and_how_it_is_flown(capsys: pytest.CaptureFixture[str]) -> None:
    assert design.run([str(MODEL), "--amplitude", "5", "--duration", "0.2", "--gust", "0.3"]) == 0
    shown = capsys.readouterr().out
    assert "short period frequency" in shown
    assert "M_delta" in shown
    assert "wingbeat gcs URL excite 3211 elevator --amplitude 5 --width 0.2" in shown
    assert "times as large" in shown


def test_the_command_says_what_a_model_lacks(tmp_path: Path) -> None:
    nameless = tmp_path / "model.toml"
    nameless.write_text(MODEL.read_text().replace('vehicle = "robo_raven_ii_d"', 'vehicle = ""'))
    with pytest.raises(InputError, match="--noise"):
        design.run([str(nameless)])
    assert design.run([str(nameless), "--noise", "0.01", "0.1", "0.1", "--duration", "0.2"]) == 0
    with pytest.raises(InputError, match="--airspeed goes with a VEHICLE"):
        design.run([str(MODEL), "--airspeed", "7"])


def test_a_planned_input_has_the_course_that_is_flown() -> None:
    planned = waveform(DOUBLET, STEP, 1.0, 0.25)
    assert planned.end - planned.start == pytest.approx(2.8)
    assert planned.command[planned.time < 1.44].max() == 0.0
    assert planned.command.max() == 0.15 and planned.command.min() == -0.15
    assert np.sum(planned.command) == pytest.approx(0.0, abs=0.31)
    assert math.isclose(float(np.sum(planned.command > 0)) * STEP, 0.2, abs_tol=2 * STEP)
