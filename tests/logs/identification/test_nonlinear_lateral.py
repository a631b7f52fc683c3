"""Lateral coefficients by nonlinear output error: the equations of motion hold, and the truth is recovered."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from output_error_cases import LATERAL_TRUTH, covered, measured, noise, steps, vector
from scipy.spatial.transform import Rotation

from groundstation.command import identify
from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Parameter, Problem
from logs.identification.estimators.output_error import output_error
from logs.identification.models.lateral import LateralAirframe, nonlinear_lateral
from logs.identification.models.stability import Steady, lateral
from logs.identification.results import Array
from wingbeat.errors import InputError

AIRFRAME = LateralAirframe(
    mass=2.0, inertia_x=0.08, inertia_z=0.16, area=0.5, span=1.6, inertia_xz=0.01, inertia_y=0.1, density=1.2,
    accelerometer_x=0.1, accelerometer_z=-0.05, vane_x=0.4,
)  # fmt: skip
TRUTH = {
    "C_Y_0": 0.0, "C_Y_beta": -0.4, "C_Y_delta_r": 0.15, "C_l_0": 0.001, "C_l_beta": -0.06, "C_l_p": -0.45,
    "C_l_r": 0.12, "C_l_delta_a": 0.12, "C_n_0": 0.0, "C_n_beta": 0.07, "C_n_p": -0.04, "C_n_r": -0.12,
    "C_n_delta_a": -0.01, "C_n_delta_r": -0.07, "C_n_beta3": 0.3,
}  # fmt: skip
MODEL = nonlinear_lateral(AIRFRAME)
OUTPUTS = ("beta", "p", "r", "phi", "a_y")


def flight(seed: int) -> Experiment:
    """20 s at 50 Hz at a changing airspeed and angle of attack: a rudder doublet, then aileron steps."""
    time = 0.02 * np.arange(1000)
    inputs = np.column_stack((
        steps(time, 8.0, 0.4, 0.12), steps(time, 1.0, 0.6, 0.2), 14.0 + np.sin(0.5 * time),
        0.1 + 0.02 * np.sin(0.9 * time), 0.05 + 0.02 * np.sin(0.6 * time), 0.02 * np.cos(0.6 * time),
        0.5 * np.cos(0.5 * time),
    ))  # fmt: skip
    clean = MODEL.simulate(vector(MODEL, TRUTH), np.array([0.02, 0.0, 0.0, 0.1]), inputs, 0.02)
    return measured(f"flight {seed}", time, MODEL, clean + noise(seed, clean.shape, 0.03 * clean.std(axis=0)), inputs)


@pytest.mark.validate
def test_derivatives_are_those_of_newton_and_euler() -> None:
    """GIVEN any state THEN force and moment balance in body axes, with the whole inertia tensor."""
    rng, a = np.random.default_rng(1), AIRFRAME
    p = rng.normal(size=len(MODEL.parameters))
    beta, roll, yaw, phi = x = np.array([0.2, 0.7, -0.4, 0.5])
    v, alpha, theta, q, growth = 15.0, 0.15, 0.1, 0.3, 0.8
    u, rates, outputs = np.array([0.1, -0.2, v, alpha, theta, q, growth]), np.empty(4), np.empty(7)
    MODEL.rates(x, u, p, MODEL.constants, rates)
    MODEL.observe(x, u, p, MODEL.constants, outputs)
    columns = np.array([1.0, beta, beta**3, roll * a.span / (2 * v), yaw * a.span / (2 * v), 0.1, -0.2])
    c_y, c_l, c_n = p.reshape(3, 7) @ columns
    force = 0.5 * 1.2 * v**2 * a.area
    omega, turning = np.array([roll, q, yaw]), np.array([rates[1], 0.0, rates[2]])
    inertia = np.array(
        [[a.inertia_x, 0.0, -a.inertia_xz], [0.0, a.inertia_y, 0.0], [-a.inertia_xz, 0.0, a.inertia_z]]
    )
    moment = inertia @ turning + np.cross(omega, inertia @ omega)
    np.testing.assert_allclose(moment[[0, 2]], force * a.span * np.array([c_l, c_n]), rtol=1e-10)
    weight = Rotation.from_euler("ZYX", [0.3, theta, phi]).inv().apply([0.0, 0.0, a.gravity])
    forward, down = v * np.cos(alpha) * np.cos(beta), v * np.sin(alpha) * np.cos(beta)
    side = growth * np.sin(beta) + v * np.cos(beta) * rates[0] + yaw * forward - roll * down
    assert side == pytest.approx(force * c_y / a.mass + weight[1])
    assert rates[3] == pytest.approx(roll + np.tan(theta) * (q * np.sin(phi) + yaw * np.cos(phi)))
    arm = np.array([a.accelerometer_x, 0.0, a.accelerometer_z])
    at_imu = np.cross(turning, arm) + np.cross(omega, np.cross(omega, arm))
    assert outputs[6] == pytest.approx(force * c_y / a.mass + at_imu[1])


def test_small_motions_are_those_of_the_linear_model() -> None:
    """GIVEN small angles at a constant airspeed THEN the motion of dimensional derivatives."""
    airframe, v = AIRFRAME._replace(inertia_xz=0.0, vane_x=0.0), 20.0
    model, linear = nonlinear_lateral(airframe), lateral(Steady(v, 0.06, 0.06, 0.1, -0.05))
    force = 0.5 * 1.2 * v**2 * airframe.area
    per_moment = {"L": airframe.inertia_x / (force * 1.6), "N": airframe.inertia_z / (force * 1.6)}
    size, truth = {"Y": airframe.mass / force} | per_moment, {}
    for name, value in LATERAL_TRUTH.items():
        axis, of = name.split("_", 1)
        size = {
            "Y": airframe.mass / force,
            "L": airframe.inertia_x / (force * 1.6),
            "N": airframe.inertia_z / (force * 1.6),
        }
        scale = 2 * v / 1.6 if of in ("p", "r") else 1.0
        truth[f"C_{axis if axis == 'Y' else axis.lower()}_{of}"] = value * size[axis] * scale
    time = 0.02 * np.arange(300)
    drive = np.column_stack((steps(time, 0.5, 0.3, 1e-4), steps(time, 1.0, 0.3, 1e-4)))
    steady = np.tile([v, 0.06, 0.06, 0.0, 0.0], (300, 1))
    ours = model.simulate(vector(model, truth), np.zeros(4), np.column_stack((drive, steady)), 0.02)
    theirs = linear.simulate(vector(linear, LATERAL_TRUTH), np.zeros(4), drive, 0.02)
    for name in ("beta", "p", "r", "phi", "a_y"):
        expected = theirs[:, list(linear.outputs).index(name)]
        np.testing.assert_allclose(ours[:, list(model.outputs).index(name)], expected, atol=2e-5 * np.ptp(expected))


def test_coefficients_are_within_their_intervals() -> None:
    count = 0
    for seed in range(6):
        free = {name: Parameter(0.6 * value) for name, value in TRUTH.items()}
        count += covered(output_error(Problem(MODEL, (flight(seed),), free, OUTPUTS)), TRUTH)
    assert count >= 0.88 * 6 * len(TRUTH)


def test_a_map_with_measured_airspeed_and_angles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a table THEN the command finds the coefficients, from starts of its own."""
    one = flight(8)
    units = {name: unit for name, unit in one.units.items() if name not in ("p_dot", "r_dot", "V_dot")}
    columns: dict[str, Array] = {"t": one.time} | {name: one.signals[name] for name in units}
    table, mapping = tmp_path / "flight.csv", tmp_path / "map.toml"
    np.savetxt(table, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    signals = "".join(f'{name} = {{ column = "{name}", unit = "{unit}" }}\n' for name, unit in units.items())
    free = "".join(f'{name} = "free"\n' for name in TRUTH)
    mapping.write_text(
        f'[time]\ncolumn = "t"\n[signals]\n{signals}[constants]\nmass = 2.0\nI_x = 0.08\nI_z = 0.16\nI_xz = 0.01\n'
        "I_y = 0.1\nS = 0.5\nb = 1.6\nrho = 1.2\nimu_x = 0.1\nimu_z = -0.05\nvane_x = 0.4\n"
        '[[aero.output_error]]\nmodel = "nonlinear lateral"\ninputs = ["delta_a", "delta_r"]\n'
        f'outputs = ["beta", "p", "r", "phi", "a_y"]\n[aero.output_error.parameters]\n{free}'
    )
    assert identify.run([str(table), "aero", "--map", str(mapping), "--json"]) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    estimates = {one["name"]: one for one in fit["estimates"]}
    assert estimates.keys() == TRUTH.keys()
    inside = [one["low"] <= TRUTH[name] <= one["high"] for name, one in estimates.items()]
    assert sum(inside) >= 13
    assert estimates["C_n_beta"]["value"] == pytest.approx(TRUTH["C_n_beta"], rel=0.15)


def test_an_impossible_airframe_is_refused() -> None:
    with pytest.raises(InputError, match="I_xz = 1 kg m"):
        nonlinear_lateral(AIRFRAME._replace(inertia_xz=1.0))
    with pytest.raises(InputError, match="span must be positive"):
        nonlinear_lateral(AIRFRAME._replace(span=0.0))
