"""The two tables of docs/identify_csv.md, flown by equations of their own; run it to make them anew.

`short_period.csv`: three 3-2-1-1 inputs of the elevator, in degrees and g at 25 Hz.
`transport.csv`: elevator and thrust inputs of a small jet transport, nonlinear, in SI with decimal commas at 10 Hz.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np

HERE = Path(__file__).parent
FINE = 20
"""-; steps of the integration in one sample"""
G = 9.80665
SHORT_PERIOD = {"Z_alpha": -1.2, "Z_delta": -0.15, "M_alpha": -6.0, "M_q": -1.5, "M_delta": -8.0}
SPEED = 100.0
TRANSPORT = {
    "C_D_0": 0.035, "C_D_alpha": 0.45, "C_L_0": 0.18, "C_L_alpha": 4.8, "C_m_0": 0.06, "C_m_alpha": -0.9,
    "C_m_q": -18.0, "C_m_delta": -1.4,
}  # fmt: skip
MASS, INERTIA, AREA, CHORD, REFERENCE, DENSITY = 7500.0, 50000.0, 30.0, 2.5, 110.0, 0.9

Rates = Callable[[np.ndarray, np.ndarray], np.ndarray]


def fly(rates: Rates, start: np.ndarray, inputs: np.ndarray, step: float, parts: int = FINE) -> np.ndarray:
    """States (N, n) by Runge-Kutta, the inputs (N, k) linear between samples."""
    states = [start]
    for before, after in pairwise(inputs):
        x, h = states[-1], step / parts
        for part in range(parts):
            u = [before + (after - before) * (part + share) / parts for share in (0.0, 0.5, 1.0)]
            k1 = rates(x, u[0])
            k2 = rates(x + h / 2 * k1, u[1])
            k3 = rates(x + h / 2 * k2, u[1])
            k4 = rates(x + h * k3, u[2])
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        states.append(x)
    return np.array(states)


def multistep(time: np.ndarray, at: float, unit: float, signs: str = "+++--+-") -> np.ndarray:
    """A 3-2-1-1 (or any other) of size 1 from ``at`` s, in steps of ``unit`` s."""
    place = np.floor((time - at) / unit + 1e-9)
    inside = (place >= 0) & (place < len(signs))
    table = np.array([1.0 if sign == "+" else -1.0 for sign in signs])
    return np.where(inside, table[np.clip(place, 0, len(signs) - 1).astype(int)], 0.0)


def short_period() -> str:
    """t s, alpha deg, q deg/s, nz g (up), elevator deg."""
    rng, t = np.random.default_rng(7), np.arange(0, 45, 0.04)
    delta = np.radians(3.0) * sum(sign * multistep(t, at, 0.36) for at, sign in ((1, 1), (16, -1), (31, 1)))
    p = SHORT_PERIOD

    def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array([
            p["Z_alpha"] * x[0] + x[1] + p["Z_delta"] * u[0],
            p["M_alpha"] * x[0] + p["M_q"] * x[1] + p["M_delta"] * u[0],
        ])  # fmt: skip

    states = fly(rates, np.zeros(2), delta[:, None], 0.04)
    lift = -SPEED * (p["Z_alpha"] * states[:, 0] + p["Z_delta"] * delta) / G
    columns = [
        t,
        np.degrees(states[:, 0]) + 4.0 + rng.normal(0, 0.1, len(t)),
        np.degrees(states[:, 1]) + rng.normal(0, 0.15, len(t)),
        1.0 + lift + rng.normal(0, 0.01, len(t)),
        np.degrees(delta) - 1.5,
    ]
    columns[1][700:725] = -999.0  # the vane's channel drops out for a second
    rows = ["t,alpha,q,nz,elevator", "s,deg,deg/s,g,deg"]
    rows += [",".join(f"{value:.4f}" for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(rows) + "\n"


def coefficients(x: np.ndarray, delta: float) -> tuple[float, float, float]:
    """C_D, C_L, C_m of the transport at V, alpha, theta, q."""
    p, rate = TRANSPORT, x[3] * CHORD / (2 * REFERENCE)
    drag = p["C_D_0"] + p["C_D_alpha"] * x[1]
    lift = p["C_L_0"] + p["C_L_alpha"] * x[1]
    return drag, lift, p["C_m_0"] + p["C_m_alpha"] * x[1] + p["C_m_q"] * rate + p["C_m_delta"] * delta


def loads(x: np.ndarray, u: np.ndarray) -> tuple[float, float, float]:
    """Drag and lift per mass (m/s^2), pitching moment per inertia (rad/s^2); inputs are elevator and thrust."""
    force = 0.5 * DENSITY * x[0] ** 2 * AREA
    drag, lift, moment = coefficients(x, u[0])
    return drag * force / MASS, lift * force / MASS, moment * force * CHORD / INERTIA


def transport_rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Of V, alpha, theta, q."""
    drag, lift, pitching = loads(x, u)
    push = u[1] / MASS
    return np.array([
        push * math.cos(x[1]) - drag + G * math.sin(x[1] - x[2]),
        x[3] + (G * math.cos(x[1] - x[2]) - lift - push * math.sin(x[1])) / x[0],
        x[3],
        pitching,
    ])  # fmt: skip


def transport_inputs(t: np.ndarray) -> tuple[float, np.ndarray]:
    """Angle of attack (rad) of the trim; elevator (rad) and thrust (N) about it (N, 2)."""
    p, force = TRANSPORT, 0.5 * DENSITY * REFERENCE**2 * AREA
    alpha = (MASS * G / force - p["C_L_0"]) / p["C_L_alpha"]
    trim_delta = -(p["C_m_0"] + p["C_m_alpha"] * alpha) / p["C_m_delta"]
    trim_thrust = (p["C_D_0"] + p["C_D_alpha"] * alpha) * force
    delta = trim_delta + np.radians(2.0) * (multistep(t, 2, 0.5) + multistep(t, 30, 3.0, "+-"))
    thrust = trim_thrust * (1 + 0.3 * multistep(t, 20, 4.0, "+-"))
    return alpha, np.column_stack((delta, thrust))


def transport() -> str:
    """Time s, airspeed m/s, alpha, theta rad, q rad/s, q_dot rad/s^2, a_x, a_z m/s^2, elevator rad, thrust N."""
    rng, t = np.random.default_rng(11), np.arange(0, 60, 0.1)
    alpha, inputs = transport_inputs(t)
    states = fly(transport_rates, np.array([REFERENCE, alpha, alpha, 0.0]), inputs, 0.1)
    drag, lift, pitching = np.array([loads(x, u) for x, u in zip(states, inputs, strict=True)]).T
    sin, cos = (np.array([of(x[1]) for x in states]) for of in (math.sin, math.cos))
    a_x, a_z = lift * sin - drag * cos + inputs[:, 1] / MASS, -lift * cos - drag * sin
    noise = (0.1, 0.0008, 0.001, 0.001, 0.005, 0.02, 0.08)
    clean = [*states.T, pitching, a_x, a_z]
    noisy = [values + rng.normal(0, size, len(t)) for values, size in zip(clean, noise, strict=True)]
    columns = [t, *noisy, *inputs.T]
    rows = [";".join(f"{value:.5f}".replace(".", ",") for value in row) for row in zip(*columns, strict=True)]
    return "\n".join(rows) + "\n"


if __name__ == "__main__":
    (HERE / "short_period.csv").write_text(short_period())
    (HERE / "transport.csv").write_text(transport())
