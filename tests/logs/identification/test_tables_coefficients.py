"""Coefficients of strangers' flights by [aero]: what the map leaves out is taken from the signals, or is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim
from test_tables_identified import codes, identified

G, SPEED, ALPHA = 9.80665, 60.0, 0.15
TRUTH = {
    "Y_beta": -9.0, "Y_delta_r": 2.5, "L_beta": -3.0, "L_p": -2.0, "L_r": 0.8, "L_delta_a": -4.0, "L_delta_r": 0.5,
    "N_beta": 1.5, "N_p": -0.15, "N_r": -0.4, "N_delta_a": -0.1, "N_delta_r": -1.2,
}  # fmt: skip
LATERAL = """
[time]
column = "t"
[signals]
beta = { column = "beta", unit = "rad" }
p = { column = "p", unit = "rad/s" }
r = { column = "r", unit = "rad/s" }
phi = { column = "phi", unit = "rad" }
a_y = { column = "a_y", unit = "m/s^2" }
V = { column = "V", unit = "m/s" }
alpha = { column = "alpha", unit = "rad" }
theta = { column = "theta", unit = "rad" }
delta_a = { column = "delta_a", unit = "rad" }
delta_r = { column = "delta_r", unit = "rad" }
[[aero.output_error]]
model = "lateral"
inputs = ["delta_a", "delta_r"]
outputs = ["beta", "p", "r", "phi", "a_y"]
[aero.output_error.parameters]
""" + "".join(f'{name} = "free"\n' for name in TRUTH)


def lateral_flight(seed: int = 0) -> dict[str, np.ndarray]:
    """Doublets of aileron and rudder at 15 deg of pitch over a level path, 20 s at 50 Hz, with noise."""
    time, of = 0.02 * np.arange(1001), TRUTH
    aileron = np.interp(time, [1.0, 1.2, 2.0, 2.4, 3.2, 3.4], np.radians([0, 4, 4, -4, -4, 0]))
    rudder = np.interp(time, [9.0, 9.2, 10.2, 10.6, 11.6, 11.8], np.radians([0, 5, 5, -5, -5, 0]))
    a = np.array([
        [of["Y_beta"] / SPEED, np.sin(ALPHA), -np.cos(ALPHA), G * np.cos(ALPHA) / SPEED],
        [of["L_beta"], of["L_p"], of["L_r"], 0.0],
        [of["N_beta"], of["N_p"], of["N_r"], 0.0],
        [0.0, 1.0, np.tan(ALPHA), 0.0],
    ])  # fmt: skip
    b = np.array([
        [0.0, of["Y_delta_r"] / SPEED], [of["L_delta_a"], of["L_delta_r"]], [of["N_delta_a"], of["N_delta_r"]],
        [0.0, 0.0],
    ])  # fmt: skip
    inputs = np.column_stack((aileron, rudder))
    _, _, states = lsim((a, b, np.eye(4), np.zeros((4, 2))), inputs, time)
    force = of["Y_beta"] * states[:, 0] + of["Y_delta_r"] * rudder
    clean = np.column_stack((states, force, np.full((len(time), 3), [SPEED, ALPHA, ALPHA])))
    noise = np.random.default_rng(seed).normal(size=clean.shape) * [1e-3, 1e-3, 1e-3, 1e-3, 0.03, 0.2, 2e-3, 1e-3]
    names = ("beta", "p", "r", "phi", "a_y", "V", "alpha", "theta")
    measured = dict(zip(names, (clean + noise).T, strict=True))
    return {"t": time, **measured, "delta_a": aileron, "delta_r": rudder}


def test_the_trims_angles_are_those_measured_where_the_map_does_not_tell_them(tmp_path: Path) -> None:
    (fit,) = identified(tmp_path, lateral_flight(), LATERAL, "aero").fits
    found = {one.name: one for one in fit.estimates}
    assert found.keys() == TRUTH.keys()
    for name, true in TRUTH.items():
        assert abs(found[name].value - true) < 1.6 * (found[name].high - found[name].value), name
    assert "trim_assumed" not in codes(fit)


@pytest.mark.validate
def test_a_trim_that_nothing_tells_is_said(tmp_path: Path) -> None:
    """GIVEN neither alpha nor theta THEN N_beta is far off at 0.15 rad, and the fit says why."""
    lines = [one for one in LATERAL.splitlines() if not one.startswith(("alpha =", "theta ="))]
    (fit,) = identified(tmp_path, lateral_flight(), "\n".join(lines), "aero").fits
    assert [one.subject for one in fit.findings if one.code == "trim_assumed"] == ["alpha", "theta"]
    assert not next(one for one in fit.estimates if one.name == "N_beta").contains(TRUTH["N_beta"])
    told = "\n".join(lines)
    told += f"\n[constants]\nalpha = {ALPHA}\ntheta = {ALPHA}\n"
    (fit,) = identified(tmp_path, lateral_flight(), told, "aero").fits
    assert "trim_assumed" not in codes(fit)


LIFT = """
[time]
column = "t"
[signals]
alpha = { column = "alpha", unit = "rad" }
a_x = { column = "a_x", unit = "m/s^2" }
a_z = { column = "a_z", unit = "m/s^2" }
[constants]
%s
S = 20.0
V = 60.0
rho = 1.0
[[aero.regressions]]
response = "C_D"
regressors = ["alpha"]
%s
"""


def gliding(thrust: float) -> dict[str, np.ndarray]:
    """C_D = 0.03 + 0.3 alpha, C_L = 0.3 + 5 alpha at 60 m/s, 2000 lb and 20 m^2, with noise in the forces."""
    time = 0.02 * np.arange(1000)
    alpha, force = 0.05 + 0.03 * np.sin(1.3 * time), 0.5 * 60.0**2 * 20.0
    drag, lift = 0.03 + 0.3 * alpha, 0.3 + 5 * alpha
    mass, noise = 2000 * 0.45359237, 0.01 * np.random.default_rng(1).normal(size=(2, 1000))
    a_x = (force * (lift * np.sin(alpha) - drag * np.cos(alpha)) + thrust) / mass + noise[0]
    a_z = -force * (lift * np.cos(alpha) + drag * np.sin(alpha)) / mass + noise[1]
    return {"t": time, "alpha": alpha, "a_x": a_x, "a_z": a_z}


@pytest.mark.parametrize("more", ["", 'method = "orthogonal"'])
def test_a_drag_with_the_thrust_in_it_is_said(tmp_path: Path, more: str) -> None:
    """GIVEN no thrust in the map THEN C_D is told with what is in it, and with thrust told it is the truth."""
    weight = 'weight = { value = 2000, unit = "lb" }'
    (fit,) = identified(tmp_path, gliding(1000.0), LIFT % (weight, more), "aero").fits
    assert "thrust_unknown" in codes(fit)
    assert not fit.estimates[0].contains(0.03)
    (fit,) = identified(tmp_path, gliding(1000.0), LIFT % (f"{weight}\nthrust = 1000.0", more), "aero").fits
    assert "thrust_unknown" not in codes(fit)
    found = {one.name: one for one in fit.estimates}
    assert abs(found["intercept"].value - 0.03) < 1.6 * (found["intercept"].high - found["intercept"].value)
    assert abs(found["alpha"].value - 0.3) < 1.6 * (found["alpha"].high - found["alpha"].value)
