"""A small flapper with four longitudinal states, its tail behind a lag, and vibration at the stroke."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import fsolve
from scipy.signal import lfilter

GRAVITY, SPEED, FINE = 9.81, 8.0, 600.0
FREQUENCY, DECAY = 2.0 * np.pi, np.log(2.0) / 2.0
"""rad/s, 1/s; of the short period: a period of 1 s that halves in 2 s"""


def system() -> tuple[np.ndarray, np.ndarray]:
    """A (4, 4) and B (4,) of u (m/s), alpha, q, theta by the elevator."""

    def matrix(m_alpha: float, m_q: float) -> np.ndarray:
        return np.array([
            [-0.12, 2.0, 0.0, -GRAVITY], [-0.30 / SPEED, -0.45, 1.0, 0.0], [0.0, m_alpha, m_q, 0.0],
            [0.0, 0.0, 1.0, 0.0],
        ])  # fmt: skip

    def error(values: np.ndarray) -> list[float]:
        roots = np.linalg.eigvals(matrix(*values))
        fastest = roots[np.argmax(roots.imag)]
        return [fastest.real + DECAY, fastest.imag - FREQUENCY]

    return matrix(*fsolve(error, [-(FREQUENCY**2 + DECAY**2), 0.45 - 2.0 * DECAY])), np.array(
        [0.0, -0.15, -22.0, 0.0]
    )


def truth() -> dict[str, float]:
    """Frequency (rad/s), damping ratio and M_alpha (1/s^2)."""
    size = float(np.hypot(FREQUENCY, DECAY))
    return {"frequency": size, "damping": DECAY / size, "M_alpha": float(system()[0][2, 1])}


def record(seed: int, rate: float, vibration: float = 0.0, duration: float = 40.0) -> dict[str, np.ndarray]:
    """Columns of 3-2-1-1 inputs of 5 degrees every 10 s, sampled at ``rate`` Hz; ``vibration`` at 5 Hz."""
    rng, (a, b) = np.random.default_rng(seed), system()
    time = np.arange(int(duration * FINE) + 1) / FINE
    command = np.zeros(len(time))
    for number, begin in enumerate(np.arange(2.0, duration - 8.0, 10.0)):
        for start, length, sign in ((0, 3, 1), (3, 2, -1), (5, 1, 1), (6, 1, -1)):
            inside = (time >= begin + 0.25 * start) & (time < begin + 0.25 * (start + length))
            command[inside] = (-1) ** number * sign * np.radians(5.0)
    share = 1.0 - np.exp(-1.0 / FINE / 0.05)
    delta = lfilter([share], [1.0, share - 1.0], command)
    block = np.zeros((5, 5))
    block[:4, :4], block[:4, 4] = a, b
    step = expm(block / FINE)
    states = np.zeros((len(time), 4))
    for k in range(len(time) - 1):
        states[k + 1] = step[:4, :4] @ states[k] + step[:4, 4] * (delta[k] + delta[k + 1]) / 2.0
    phase = rng.uniform(0.0, 2.0 * np.pi, 4)

    def shaken(n: int) -> np.ndarray:
        turn = 2.0 * np.pi * 5.0 * time
        return vibration * (np.sin(turn + phase[n]) + 0.3 * np.sin(2.0 * turn + phase[(n + 1) % 4]))

    force = SPEED * (a[1, 1] * states[:, 1] + a[1, 0] * states[:, 0] + b[1] * delta)
    columns = {
        "t": time, "alpha": 0.08 + states[:, 1] + 0.03 * shaken(0), "q": states[:, 2] + 0.6 * shaken(1),
        "az": force - GRAVITY + 6.0 * shaken(3), "de": delta - 0.02,
    }  # fmt: skip
    rows = np.round(np.arange(0, len(time) - 1, FINE / rate)).astype(int)
    sampled = {name: values[rows] for name, values in columns.items()}
    for name, size in (("alpha", 0.006), ("q", 0.02), ("az", 0.25), ("de", 0.0005)):
        sampled[name] = sampled[name] + size * rng.standard_normal(len(rows))
    return sampled
