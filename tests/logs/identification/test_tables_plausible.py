"""Signals that contradict one another are refused with the mistake that explains it; those that agree are not."""

from __future__ import annotations

import numpy as np
import pytest

from avionics.constants import STANDARD_GRAVITY
from avionics.quantities import BadInput
from logs.identification.experiment import Experiment
from logs.identification.tables.plausible import check_plausible

STEP, SPEED = 0.02, 20.0
UNITS = {"alpha": "rad", "theta": "rad", "q": "rad/s", "a_z": "m/s^2"}


def flown(imu_x: float = 0.0, noise: float = 1.0, seed: int = 1, **scales: float) -> Experiment:
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


def without(one: Experiment, *names: str) -> Experiment:
    return one._replace(signals={name: values for name, values in one.signals.items() if name not in names})


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("scale", [0.85, 1.0, 1.15])
@pytest.mark.parametrize("imu_x", [0.0, 0.4])
def test_a_flight_with_errors_of_scale_is_none_of_these_mistakes(seed: int, scale: float, imu_x: float) -> None:
    check_plausible((flown(imu_x, seed=seed, alpha=scale, a_z=scale),), {"V": SPEED})


@pytest.mark.parametrize(
    ("scales", "said"),
    [
        ({"a_z": -1.0}, r"a_z is \+9\.\d m/s\^2 on the mean .* scale = -1\.0"),
        ({"a_z": STANDARD_GRAVITY}, "it is in m/s.2 already, not in g"),
        ({"a_z": 1.0 / STANDARD_GRAVITY}, "a_z does not fit the changes of alpha and q: it is in g, not in m/s"),
        ({"theta": -1.0}, "theta changes against q"),
        ({"theta": np.pi / 180}, "theta changes 57 times as slowly as q says"),
        ({"q": 180 / np.pi, "alpha": 1.0}, "57 times as slowly as q says"),
    ],
)
def test_a_known_mistake_is_named(scales: dict[str, float], said: str) -> None:
    with pytest.raises(BadInput, match=said):
        check_plausible((flown(**scales),), {"V": SPEED})


def test_the_sign_of_an_a_z_without_its_mean_is_told_by_alpha_and_q() -> None:
    one = flown(a_z=-1.0)
    level = one.signals["a_z"] - one.signals["a_z"].mean()
    with pytest.raises(BadInput, match="a_z is against the changes of alpha and q: its sign is wrong"):
        check_plausible((one._replace(signals={**one.signals, "a_z": level}),), {"V": SPEED})


def test_nothing_is_concluded_from_noise_gaps_or_missing_signals() -> None:
    noisy = flown(noise=60.0, theta=-1.0)
    gaps = flown(theta=-1.0)
    gaps.signals["q"][::10] = np.nan
    for one in (noisy, gaps, without(flown(theta=-1.0), "q"), without(flown(a_z=-1.0), "a_z", "theta")):
        check_plausible((one,), {})
