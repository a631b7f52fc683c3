"""Signals that contradict each other are reported with the correction that explains it; consistent ones are not."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from output_error_cases import LATERAL, LATERAL_TRUTH, steps
from output_error_cases import simulated as flown_laterally

from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.estimates import unusual_signs
from logs.identification.diagnostics.table import diagnose
from logs.identification.results import Estimate, EstimationResult, estimate
from wingbeat.constants import STANDARD_GRAVITY

STEP, SPEED = 0.02, 20.0
UNITS = {"alpha": "rad", "theta": "rad", "q": "rad/s", "a_z": "m/s^2"}


def simulated(imu_x: float = 0.0, noise: float = 1.0, seed: int = 1, **scales: float) -> Experiment:
    """A short period after doublets, level flight; each of ``scales`` multiplies a signal."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 12.0, STEP)
    delta = 0.1 * np.sign(np.sin(2.0 * np.pi * time / 3.0)) * (np.sin(2.0 * np.pi * time / 6.0) > 0)
    states, q_dot = np.zeros((len(time), 3)), np.zeros(len(time))
    for k in range(len(time)):
        alpha, q, _ = states[k]
        q_dot[k] = -20.0 * alpha - 3.0 * q + 15.0 * delta[k]
        if k + 1 < len(time):
            states[k + 1] = states[k] + STEP * np.array([q - 2.5 * alpha, q_dot[k], q])
    alpha, q, theta = states.T
    signals = {"alpha": 0.08 + alpha, "theta": 0.08 + theta, "q": q}
    signals["a_z"] = -STANDARD_GRAVITY - 2.5 * SPEED * alpha - imu_x * q_dot
    for name, size in (("alpha", 2e-3), ("theta", 2e-3), ("q", 4e-3), ("a_z", 0.2)):
        signals[name] = (signals[name] + noise * size * rng.normal(size=len(time))) * scales.get(name, 1.0)
    return Experiment("one", time, signals, UNITS)


def findings_of(one: Experiment, constants: Mapping[str, float]) -> list[tuple[str, str]]:
    """Code and subject of every finding on the data."""
    return [(each.code, each.subject) for each in diagnose("data", Context((one,), constants))]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [0.85, 1.0, 1.15])
@pytest.mark.parametrize("imu_x", [0.0, 0.4])
def test_scale_errors_of_sensors_are_consistent(seed: int, scale: float, imu_x: float) -> None:
    assert findings_of(simulated(imu_x, seed=seed, alpha=scale, a_z=scale), {"V": SPEED}) == []


@pytest.mark.parametrize(
    ("scales", "expected"),
    [
        ({"a_z": -1.0}, ("sign", "a_z")),
        ({"a_z": STANDARD_GRAVITY}, ("unit", "a_z")),
        ({"a_z": 1.0 / STANDARD_GRAVITY}, ("unit", "a_z")),
        ({"theta": -1.0}, ("sign", "q")),
        ({"theta": np.pi / 180}, ("unit", "q")),
    ],
)
def test_a_wrong_sign_or_unit_is_reported(scales: dict[str, float], expected: tuple[str, str]) -> None:
    assert expected in findings_of(simulated(**scales), {"V": SPEED})


def test_a_time_in_milliseconds_is_reported() -> None:
    one = simulated()
    assert ("unit", "time") in findings_of(one._replace(time=1000.0 * one.time), {"V": SPEED})


@pytest.mark.parametrize("unit", [3600.0 / 1852.0, 1.0 / 0.3048, 3.6])
def test_an_airspeed_in_another_unit_is_reported(unit: float) -> None:
    for speed in (SPEED * unit, SPEED / unit):
        assert ("unit", "V") in findings_of(simulated(noise=0.3), {"V": speed})
    level = simulated()._replace(signals=simulated().signals | {"V": np.full(len(simulated().time), SPEED)})
    assert ("unit", "constants.V") in findings_of(level, {"V": SPEED * unit})
    assert findings_of(level, {"V": 14.0}) == [] == findings_of(level, {"V": 30.0})


def turning(seed: int = 1, **scales: float) -> Experiment:
    """Speed, bank, pitch and sideslip that swing as prescribed, 20 s; specific forces and rates follow."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, STEP)
    theta, phi = 0.1 + 0.08 * np.sin(0.5 * time), 0.3 * np.sin(0.6 * time)
    u, v = 30.0 + 3.0 * np.cos(0.5 * time), 1.5 * np.sin(1.1 * time)
    w, heading = 2.0 + 0.5 * np.sin(0.9 * time), 0.15 * np.sin(0.6 * time)
    p = np.gradient(phi, STEP) - heading * np.sin(theta)
    q = np.gradient(theta, STEP) * np.cos(phi) + heading * np.cos(theta) * np.sin(phi)
    r = -np.gradient(theta, STEP) * np.sin(phi) + heading * np.cos(theta) * np.cos(phi)
    g, speed = STANDARD_GRAVITY, np.sqrt(u**2 + v**2 + w**2)
    a_x = np.gradient(u, STEP) + q * w - r * v + g * np.sin(theta)
    a_y = np.gradient(v, STEP) + r * u - p * w - g * np.cos(theta) * np.sin(phi)
    signals = {"V": speed, "alpha": np.arctan2(w, u), "beta": np.arcsin(v / speed), "theta": theta, "phi": phi}
    signals |= {"p": p, "q": q, "r": r, "a_x": a_x + 0.2, "a_y": a_y - 0.15}
    for name, size in (("V", 0.3), ("alpha", 3e-3), ("beta", 3e-3), ("a_x", 0.1), ("a_y", 0.1)):
        signals[name] = (signals[name] + size * rng.normal(size=len(time))) * scales.get(name, 1.0)
    return Experiment("one", time, signals, {})


@pytest.mark.parametrize("scales", [{}, {"V": 1.05}, {"a_y": 0.9}, {"r": 1.05, "p": 0.95}, {"phi": 0.93}])
def test_a_turning_flight_with_scale_errors_is_consistent(scales: dict[str, float]) -> None:
    for seed in range(6):
        assert findings_of(turning(seed, **scales), {}) == []


def rung(seed: int, speed: float, noise: tuple[float, float, float]) -> Experiment:
    """A lightly damped motion that fades, 30 Hz, with ``noise`` of alpha (rad), q (rad/s) and a_z (m/s^2)."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 20.0, 1.0 / 30.0)
    lift, rate = -0.45, np.array([[-0.45, 1.0], [-39.3, -0.24]])
    values, vectors = np.linalg.eig(rate)
    weights = np.linalg.solve(vectors, np.array([0.15, 0.0]))
    alpha, q = np.real((vectors * weights) @ np.exp(np.outer(values, time)))
    signals = {"alpha": 0.1 + alpha, "q": q, "a_z": lift * speed * alpha - STANDARD_GRAVITY}
    for name, size in zip(signals, noise, strict=True):
        signals[name] = signals[name] + size * rng.normal(size=len(time))
    return Experiment("rung", time, signals, UNITS)


@pytest.mark.parametrize("force", [0.2, 0.5])
def test_a_decaying_motion_in_noise_is_consistent(force: float) -> None:
    for seed in range(40):
        assert findings_of(rung(seed, 7.0, (0.005, 0.017, force)), {"V": 7.0}) == []


SIDEWAYS = {"V": 20.0, "theta": 0.06, "alpha": 0.06}


def sideslipping(seed: int, noise: float, **scales: float) -> Experiment:
    """The lateral motion after steps of both controls; each of ``scales`` multiplies a signal."""
    time = 0.02 * np.arange(1000)
    inputs = np.column_stack((steps(time, 9.0, 0.3, 0.05), steps(time, 1.0, 0.4, 0.08)))
    record = flown_laterally(LATERAL, LATERAL_TRUTH, inputs, 0.02, noise, seed)
    return record._replace(
        signals={name: scales.get(name, 1.0) * np.asarray(v) for name, v in record.signals.items()}
    )


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_a_lateral_motion_is_consistent(noise: float) -> None:
    for seed in range(10):
        assert findings_of(sideslipping(seed, noise, beta=1.2, a_y=0.9), SIDEWAYS) == []


@pytest.mark.parametrize(
    ("scales", "expected"),
    [
        ({"a_y": -1.0}, ("sign", "a_y")),
        ({"a_y": 1.0 / STANDARD_GRAVITY}, ("unit", "a_y")),
        ({"r": -1.0}, ("sign", "r")),
        ({"r": np.pi / 180}, ("unit", "r")),
        ({"beta": -1.0}, ("sign", "beta")),
    ],
)
def test_a_wrong_sign_or_unit_of_the_lateral_motion_is_reported(
    scales: dict[str, float], expected: tuple[str, str]
) -> None:
    for seed in range(5):
        assert expected in findings_of(sideslipping(seed, 0.02, **scales), SIDEWAYS)


def test_unusual_signs_are_reported_with_their_number() -> None:
    def one(name: str, value: float) -> Estimate:
        return estimate(name, "", value, 0.1)

    def signs(response: str, *estimates: Estimate) -> list[str]:
        result = EstimationResult("equation_error", estimates=estimates, response=response)
        return [each.subject for each in unusual_signs(Context((), result=result))]

    assert signs("", one("Y_beta", -3.0), one("L_p", 0.1), one("Z_alpha", -1.0), one("C_D_0", 0.5)) == []
    assert signs("", one("Y_beta", 3.0), one("L_p", 1.0), one("M_alpha", 4.0)) == ["Y_beta", "L_p"]
    assert signs("C_D", one("intercept", -0.5), one("alpha", 3.0)) == ["intercept"]
