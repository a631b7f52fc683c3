"""Regressions whose truth is known, under noise of any colour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from logs.identification.data.experiment import Experiment

Array = NDArray[np.float64]
LENGTH = 10.0
"""s"""
TRUTH = {"intercept": 0.4, "alpha": 3.0, "q": -0.5, "delta": 0.7}
KINDS = ("white", "AR 0.5", "AR 0.9", "AR 0.97", "flapping")
UNITS = {"alpha": "rad", "q": "rad/s", "delta": "rad", "C": "-"}


def noise(kind: str, count: int, rng: np.random.Generator) -> Array:
    """Stationary noise (N,): white, an autoregression of first order, or a narrow band at the flapping frequency."""
    white = rng.normal(size=count + 2000)
    if kind == "flapping":
        turn = 2 * np.pi * (60 / count if count > 200 else 0.15)
        colored = lfilter([1.0], [1.0, -1.94 * np.cos(turn), 0.97**2], white)
    else:
        colored = lfilter([1.0], [1.0, -float(kind.removeprefix("AR ") if kind != "white" else 0.0)], white)
    return np.asarray(colored[-count:])


def motion(count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Angle of attack, pitch rate and elevator (N,) of a 3-2-1-1 with small steps, each of unit variance."""
    time = np.arange(count) * LENGTH / count
    delta = 0.3 * np.repeat(rng.normal(size=20), -(-count // 20))[:count]
    for sign, start, end in ((1, 0.8, 2.3), (-1, 2.3, 3.3), (1, 3.3, 3.8), (-1, 3.8, 4.3)):
        delta = delta + sign * ((time >= start) & (time < end))
    a, b = np.array([[-1.5, 1.0], [-12.0, -2.5]]), np.array([[0.0], [-6.0]])
    f, g, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), LENGTH / count)
    states = np.zeros((count, 2))
    for k in range(count - 1):
        states[k + 1] = f @ states[k] + g[:, 0] * delta[k]
    alpha, q = (states / states.std(axis=0)).T
    return alpha, q, delta / delta.std()


def simulated(kind: str, count: int, seed: int, size: float = 1.0, name: str = "flight") -> Experiment:
    """An experiment of ``count`` samples in 10 s whose coefficient C is `TRUTH` plus ``size`` times noise."""
    rng = np.random.default_rng(seed)
    alpha, q, delta = motion(count, rng)
    clean = TRUTH["intercept"] + TRUTH["alpha"] * alpha + TRUTH["q"] * q + TRUTH["delta"] * delta
    signals = {"alpha": alpha, "q": q, "delta": delta, "C": clean + size * noise(kind, count, rng)}
    return Experiment(name, np.arange(count) * LENGTH / count, signals, UNITS)
