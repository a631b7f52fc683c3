"""The servo's torque-speed line and the wing's load, against known constants."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.data.flight import DriveData, GaugeErrors
from logs.identification.estimators.bench import identify_load, identify_torque_speed, load_truth
from logs.identification.results import Array, Estimate, EstimationResult
from sim_bridge.actuators.drives import torque_bound
from wingbeat.errors import InputError

STALL, SPEED, NOMINAL = 2.25, 20.5, 8.0


def bench(seed: int = 0, noise: float = 0.02, sag: float = 0.5) -> tuple[Array, Array, Array]:
    """A servo of the world at its bound, braked from no load to a stall, both ways round."""
    rng = np.random.default_rng(seed)
    rate = rng.uniform(0.0, 16.0, 200) * np.sign(rng.normal(size=200))
    voltage = NOMINAL + sag * rng.normal(size=200)
    ratio = voltage / NOMINAL
    torque = np.array(
        [np.sign(w) * torque_bound(w, np.sign(w), STALL * r, SPEED * r) for w, r in zip(rate, ratio, strict=True)]
    )
    return torque + noise * rng.normal(size=200), rate, voltage


def by_name(model: EstimationResult) -> dict[str, Estimate]:
    return {found.name: found for found in model.estimates}


def test_stall_torque_and_no_load_speed_of_the_world_s_servo() -> None:
    hits = {"stall_torque": 0, "no_load_speed": 0, "torque_speed_slope": 0}
    truth = {"stall_torque": STALL, "no_load_speed": SPEED, "torque_speed_slope": STALL / SPEED}
    for seed in range(20):
        for name, found in by_name(identify_torque_speed(*bench(seed), NOMINAL)).items():
            hits[name] += found.contains(truth[name])
            assert found.value == pytest.approx(truth[name], rel=0.02)
    assert min(hits.values()) >= 17


def test_one_voltage_gives_the_line_at_that_voltage() -> None:
    torque, rate, _ = bench(sag=0.0)
    found = by_name(identify_torque_speed(torque, rate, np.full_like(rate, NOMINAL)))
    assert found["stall_torque"].value == pytest.approx(STALL, rel=0.02)


def test_a_servo_that_is_not_at_its_bound_is_refused() -> None:
    _, rate, voltage = bench()
    rng = np.random.default_rng(1)
    model = identify_torque_speed(0.5 * np.sign(rate) + 0.1 * rng.normal(size=len(rate)), rate, voltage)
    assert model.estimates == ()
    assert "not at its bound" in model.withheld[0].text
    still = identify_torque_speed(np.full(40, 2.0), np.full(40, 5.0), np.full(40, 8.0))
    assert "rate does not vary" in still.withheld[0].text
    with pytest.raises(InputError, match="samples together"):
        identify_torque_speed(np.full(40, np.nan), rate[:40], voltage[:40])
    with pytest.raises(InputError, match="same number"):
        identify_torque_speed(rate[:40], rate, voltage)


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_speed_whose_noise_is_of_the_other_sign_does_not_turn_the_torque(way: float) -> None:
    hits: dict[str, int] = {}
    for seed in range(20):
        rng = np.random.default_rng(seed)
        rate = np.concatenate(([0.01, 0.02, 0.05, 20.4], rng.uniform(0.0, 0.9 * SPEED, 36)))
        torque = way * (STALL - STALL / SPEED * rate) + 0.02 * rng.normal(size=40)
        rate = way * (rate + np.concatenate(([-0.1, -0.1, -0.2, 0.0], 0.05 * rng.normal(size=36))))
        for name, found in by_name(identify_torque_speed(torque, rate, np.full(40, NOMINAL))).items():
            truth = {"stall_torque": STALL, "no_load_speed": SPEED, "torque_speed_slope": STALL / SPEED}[name]
            hits[name] = hits.get(name, 0) + found.contains(truth)
            assert found.value == pytest.approx(truth, rel=0.03), (seed, name)
    assert len(hits) == 3 and min(hits.values()) >= 17


def test_torque_against_the_speed_is_refused_by_its_sign() -> None:
    torque, rate, voltage = bench()
    model = identify_torque_speed(torque, -rate, voltage, NOMINAL)
    assert model.estimates == ()
    assert "opposite signs" in model.withheld[0].text


def flapping(seed: int = 0, amplitude: float = 0.4, wander: float = 1.0, ripple: float = 0.0) -> DriveData:
    """Wings with a load of 0.2 N m s/rad and an inertia of 0.004 kg m^2 at a frequency that wanders about 4 Hz.

    ``ripple`` in N m is that of a servo whose corrections, locked to the stroke, fold at the gauges' 100 Hz.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(0, 20.0, 0.005)
    turning = 2 * np.pi * (4.0 + wander * np.sin(2 * np.pi * time / 5))
    turn = 2 * np.pi * (4.0 * time + wander * (1.0 - np.cos(2 * np.pi * time / 5)) * 5 / (2 * np.pi))
    rate = amplitude * 25.0 * (np.cos(turn) + 0.2 * np.cos(3 * turn))
    acceleration = -amplitude * 25.0 * turning * (np.sin(turn) + 0.6 * np.sin(3 * turn))
    torque = 0.2 * rate + 0.004 * acceleration + 0.05 + ripple * np.cos(22 * turn)
    gauges = torque[::2] + 0.01 * rng.normal(size=(2, len(time[::2])))
    nothing = np.zeros(0)
    return DriveData(
        nothing, nothing, nothing, 0.01, time[::2], gauges[0], gauges[1], time, rate, rate, turn / (2 * np.pi)
    )


def test_the_wing_s_torque_constant_and_inertia() -> None:
    found = by_name(identify_load(flapping()))
    assert found["wing_torque_constant"].value == pytest.approx(0.2, rel=0.01)
    assert found["wing_inertia"].value == pytest.approx(0.004, rel=0.02)


def test_a_servo_s_ripple_is_not_taken_for_inertia() -> None:
    found = by_name(identify_load(flapping(ripple=0.1)))
    assert found["wing_torque_constant"].contains(0.2)
    assert found["wing_inertia"].contains(0.004)


def test_at_one_frequency_inertia_and_stiffness_look_alike() -> None:
    model = identify_load(flapping(wander=0.0))
    assert by_name(model)["wing_torque_constant"].value == pytest.approx(0.2, rel=0.01)
    assert [(one.subject, "look alike" in one.text) for one in model.withheld] == [("wing_inertia", True)]


def test_wings_that_hardly_flapped_tell_nothing() -> None:
    few = flapping()
    short = few.wing_time < 2.0
    cut = few._replace(
        wing_time=few.wing_time[short],
        rate_left=few.rate_left[short],
        rate_right=few.rate_right[short],
        strokes=few.strokes[short],
    )
    with pytest.raises(InputError, match=r"made \d strokes; their load needs 10"):
        identify_load(cut)


def test_strokes_of_which_the_motion_is_not_known_are_left_out() -> None:
    """GIVEN a second of the wings' motion is missing THEN the load is that of the rest."""
    whole = flapping()
    there = (whole.wing_time < 8.0) | (whole.wing_time > 9.03)
    holed = whole._replace(
        wing_time=whole.wing_time[there],
        rate_left=whole.rate_left[there],
        rate_right=whole.rate_right[there],
        strokes=whole.strokes[there],
    )
    found = by_name(identify_load(holed))
    assert found["wing_torque_constant"].value == pytest.approx(0.2, rel=0.01)
    assert found["wing_inertia"].value == pytest.approx(0.004, rel=0.02)


def test_what_calibrations_leave_of_the_torque_is_in_the_interval() -> None:
    sure, doubted = (by_name(identify_load(flapping(), GaugeErrors(torque_scale=s))) for s in (0.0, 0.05))
    half = doubted["wing_torque_constant"].high - doubted["wing_torque_constant"].value
    assert half == pytest.approx(1.96 * 0.2 * 0.05 / np.sqrt(2.0), rel=0.02)
    assert sure["wing_torque_constant"].value == doubted["wing_torque_constant"].value


def test_one_wing_that_stands_still_leaves_no_load_to_tell() -> None:
    one = flapping()
    assert "do not move" in identify_load(one._replace(rate_right=0.0 * one.rate_right)).withheld[0].text


def test_the_truth_is_the_same_regression_on_true_drives() -> None:
    assert load_truth(flapping(), identify_load(flapping(wander=0.0))).keys() == {"wing_torque_constant"}


def test_wings_at_rest_have_no_load_that_could_be_told() -> None:
    assert "do not move" in identify_load(flapping(amplitude=0.0)).withheld[0].text
    nothing = np.zeros(0)
    with pytest.raises(InputError, match="no motion of the wings"):
        identify_load(flapping()._replace(wing_time=nothing))
