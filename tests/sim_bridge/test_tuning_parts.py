"""Margins of loops known by heart, blocks against their formulas, model files, all axes' model."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path

import control
import numpy as np
import pytest
from tuning_bench import MODELS, VEHICLES, model

from avionics.stabilization import stroke_filter
from sim_bridge.flight_mechanics.averaged import stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.modes import DUTCH_ROLL, modes
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import LoopSpec, Process, Terms, loop_margins, search
from sim_bridge.tuning.margins import bandwidth, frequencies, margins, response
from sim_bridge.tuning.model import is_model_file, load_model, model_of, model_text, save_model
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError


def test_the_margins_of_a_loop_known_by_heart() -> None:
    """k/(s (s + 1)^2) turns unstable at k = 2, at 1 rad/s."""
    found = margins(control.ss(control.tf([1.0], [1.0, 2.0, 1.0, 0.0])))
    assert found.gain_db == pytest.approx(20.0 * math.log10(2.0), abs=1e-3)
    assert found.stable
    crossover = found.crossover
    assert crossover * (1.0 + crossover**2) == pytest.approx(1.0, rel=1e-4)
    assert found.phase == pytest.approx(math.pi / 2.0 - 2.0 * math.atan(crossover), abs=1e-4)
    assert not margins(control.ss(control.tf([2.1], [1.0, 2.0, 1.0, 0.0]))).stable


def test_a_margin_downwards_counts() -> None:
    """k/(s - 1) needs k above 1: with k = 1.5 a loss of 3.5 dB is the end."""
    found = margins(control.ss(control.tf([1.5], [1.0, -1.0])))
    assert found.stable
    # Gain falls to 1.5 at the left end of the grid, where the phase is -180 degrees within a hundredth.
    assert found.gain_db == pytest.approx(20.0 * math.log10(1.5), abs=0.01) or math.isinf(found.gain_db)


@pytest.mark.parametrize("speed", [0.1, 3.0, 40.0])
def test_the_bandwidth_of_a_lag_is_its_corner(speed: float) -> None:
    omega = frequencies()
    assert bandwidth(omega, 1.0 / (1.0 + 1j * omega / speed)) == pytest.approx(speed, rel=1e-3)
    assert bandwidth(omega, np.ones(len(omega), dtype=complex)) == omega[-1]
    assert bandwidth(omega, np.full(len(omega), 0.5 + 0j)) == 0.0


def test_the_notch_is_the_filter_that_flies() -> None:
    """Frequency response of the flight code's steps at 100 Hz against the block."""
    dt, frequency, width = 0.01, 4.0, 0.3
    block = blocks.notch(frequency, width, "in", "out")
    for omega in (2.0, 8.0, 15.0, 25.0):
        state, out = stroke_filter.State(), []
        times = np.arange(6000) * dt
        for time in times:
            state, value = stroke_filter.step(
                state, math.sin(omega * time), stroke_filter.notch(frequency, width, dt)
            )
            out.append(value)
        late = times > 30.0
        basis = np.column_stack((np.sin(omega * times), np.cos(omega * times)))[late]
        a, b = np.linalg.lstsq(basis, np.array(out)[late], rcond=None)[0]
        assert complex(a, b) == pytest.approx(complex(response(block, np.array([omega]))[0]), abs=0.03)


def test_delay_lag_and_mean_against_their_formulas() -> None:
    omega = np.array([0.5, 5.0, 20.0])
    assert response(blocks.delay(0.015, "a", "b"), omega) == pytest.approx(np.exp(-0.015j * omega), abs=1e-6)
    assert response(blocks.lag(0.0, "a", "b"), omega) == pytest.approx(np.ones(3))
    slow, period = np.array([0.2, 0.5]), 0.25
    mean = (1.0 - np.exp(-1j * slow * period)) / (1j * slow * period)
    assert response(blocks.stroke_mean(4.0, "a", "b"), slow) == pytest.approx(mean, abs=2e-3)


def lagging_process() -> Process:
    plant = control.ss(control.tf([1.0], [1.0, 1.0, 0.0]) * control.tf(*control.pade(0.1, 3)))
    both = control.ss(plant.A, plant.B, np.vstack((plant.C, plant.C)), np.zeros((2, 1)))
    return Process(plant, both)


def test_a_search_stays_in_its_limits_and_leaves_no_faster_gain_out() -> None:
    process = lagging_process()
    found = search(process, LoopSpec(20.0, False, False, (100.0, 0.0, 0.0)))
    assert found.integral == 0.0 and found.damping == 0.0
    assert loop_margins(process, found).phase >= math.radians(45.0)
    assert loop_margins(process, found).sensitivity <= 2.0
    faster = Terms(1.15 * found.proportional, 0.0, 0.0)
    resonance = np.max(np.abs(1.0 - 1.0 / (1.0 + response(process.followed, frequencies()) * faster.proportional)))
    beyond = loop_margins(process, faster)
    assert beyond.phase < math.radians(45.0) or beyond.sensitivity > 2.0 or resonance > 1.3
    slowed = search(process, LoopSpec(20.0, False, False, (100.0, 0.0, 0.0), steepest=0.2))
    assert slowed.proportional <= 0.2


def test_a_search_without_a_way_says_so() -> None:
    with pytest.raises(InputError, match="no gains give this loop 6 dB and 45 degrees below 2 rad/s"):
        search(lagging_process(), LoopSpec(2.0, False, False, (1e-6, 0.0, 0.0)))


@pytest.mark.parametrize("name", VEHICLES)
def test_a_model_survives_its_file(name: str, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    save_model(path, model(name))
    assert is_model_file(path)
    assert model_text(load_model(path)) == path.read_text() == model_text(model(name))
    as_json = tmp_path / "model.json"
    as_json.write_text(json.dumps(tomllib.loads(path.read_text())))
    assert model_text(load_model(as_json)) == model_text(model(name))
    with pytest.raises(InputError, match="exists already"):
        save_model(path, model(name))


@pytest.mark.parametrize(
    ("change", "error_text"),
    [
        (("airspeed = 6.8", "airspeed = -6.8"), "trim.airspeed = -6.8 must be above 0 m/s"),
        (("frequency = 4", "# frequency = 4"), "trim.frequency is missing (above 0 Hz)"),
        (
            ('input = "half_stroke"', 'input = "petrol"'),
            "drive.input = 'petrol' is not known; known: throttle, half_stroke",
        ),
        (("lag = 0.0", "lag = -0.0"), "must be 0 s or more"),
        (("    [0, 0, 1, 0],\n", ""), "longitudinal.a must be a list of 4 lists of 4 numbers"),
        (("at = 0.2541792", 'at = "much"'), "drive.at must be a number"),
        (("at = 0.2541792", "at = nan"), "drive.at must be a finite number"),
        (("at = 0.2541792", "at = 1\nby = 2"), "unknown key drive.by"),
        (("[trim]", "[trimmed]"), "unknown key trimmed"),
        (("[trim]", "[trim"), "not valid TOML"),
    ],
)
def test_a_damaged_model_file_is_refused_in_one_line(
    change: tuple[str, str], error_text: str, tmp_path: Path
) -> None:
    text = (MODELS / "robo_raven_ii_d.toml").read_text()
    assert change[0] in text
    path = tmp_path / "bad.toml"
    path.write_text(text.replace(*change))
    with pytest.raises(InputError, match=re.escape(error_text)) as refusal:
        load_model(path)
    assert "\n" not in str(refusal.value) and "bad.toml" in str(refusal.value)


@pytest.mark.validate
@pytest.mark.parametrize("name", VEHICLES)
def test_the_kept_models_are_those_of_the_vehicles(name: str) -> None:
    """And what four states explain of the averaged answers, the signs, and the dutch roll by the stroke map."""
    world, kept = load_vehicle(name), model(name)
    orbit = trim(world, kept.airspeed, 0.0)
    axes = axes_model(world, orbit, stroke_averaged_model(world, orbit))
    found = model_of(world, orbit, axes)
    assert np.all(axes.unexplained < 0.02)
    assert found.drive is not None and kept.drive is not None
    assert found.lateral is not None and kept.lateral is not None
    for ours, theirs in (
        (found.a, kept.a),
        (found.elevator, kept.elevator),
        (found.drive.b, kept.drive.b),
        (found.lateral.a, kept.lateral.a),
        (found.lateral.rudder, kept.lateral.rudder),
    ):
        assert ours == pytest.approx(theirs, rel=0.02, abs=0.02 * float(np.max(np.abs(theirs))))
    assert found.drive.lag == pytest.approx(kept.drive.lag, abs=0.01)
    assert found.drive.b[0] > 0.0, "more thrust drives ahead"
    assert found.lateral.rudder[2] > 0.0, "right rudder yaws right"
    assert found.lateral.a[1, 0] < 0.0, "dihedral: slipping right rolls left"
    assert found.lateral.a[2, 0] > 0.0, "weathercock: slipping right yaws right"
    assert found.lateral.a[1, 1] < 0.0, "wings damp the roll"
    exact = next(mode for mode in modes(world, orbit) if mode.name == DUTCH_ROLL)
    swinging = [root for root in np.linalg.eigvals(found.lateral.a) if root.imag > 0.0]
    assert len(swinging) == 1
    assert abs(swinging[0]) == pytest.approx(exact.natural_frequency, rel=0.05)


def test_a_cranks_lag_is_found_again() -> None:
    """The motor's own time constant, and what the stroke's average and the air add."""
    drive = model("arizona_100cm").drive
    assert drive is not None
    assert drive.lag == pytest.approx(load_vehicle("arizona_100cm").drive.spin_time_constant, abs=0.03)
