"""The models that output error flies: beside scipy's and python-control's simulations, and the physics they hold."""

from __future__ import annotations

import control
import numpy as np
import pytest
from output_error_cases import (
    JET,
    JET_TRUTH,
    LATERAL,
    LATERAL_TRUTH,
    LONGITUDINAL,
    LONGITUDINAL_TRUTH,
    covered,
    measured,
    noise,
    steps,
    vector,
)
from scipy.integrate import solve_ivp
from scipy.signal import lsim

from logs.identification.estimators.engine.problem import Parameter, Problem
from logs.identification.estimators.output_error import output_error
from logs.identification.models.actuators import Actuated, Actuator, actuated
from logs.identification.models.linear import LinearModel
from logs.identification.models.nonlinear_longitudinal import nonlinear_longitudinal
from logs.identification.models.stability import Steady, lateral, longitudinal, short_period
from wingbeat.errors import InputError

TIME = 0.02 * np.arange(400)


@pytest.mark.parametrize(
    ("model", "truth"),
    [(LONGITUDINAL, LONGITUDINAL_TRUTH), (LATERAL, LATERAL_TRUTH)],
    ids=["longitudinal", "lateral"],
)
def test_linear_flight_is_that_of_scipy_and_control(model: LinearModel, truth: dict[str, float]) -> None:
    k = len(model.inputs)
    inputs = np.column_stack([steps(TIME, 0.5 + i, 0.4, 0.05) for i in range(k)])
    start, p = np.array([0.3, -0.02, 0.1, 0.05]), vector(model, truth)
    ours = model.simulate(p, start, inputs, 0.02)
    a, b, c, d = model.matrices(p)
    _, theirs, _ = lsim((a, b[:, :k], c, d[:, :k]), inputs, TIME, start)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-10)
    other = control.forced_response(control.ss(a, b[:, :k], c, d[:, :k]), TIME, inputs.T, start)
    np.testing.assert_allclose(ours, other.outputs.T, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("step", [10.0, 1 / 600])
def test_linear_flight_is_exact_at_any_rate(step: float) -> None:
    model = short_period(Steady(20.0), pitch=True)
    p = vector(model, {"Z_alpha": -2.0, "M_alpha": -15.0, "M_q": -3.0, "M_0": 0.3})
    simulated = model.simulate(p, np.array([0.1, 0.0, 0.0]), np.zeros((50, 1)), step)
    a, b, _, _ = model.matrices(p)
    trim = np.linalg.solve(a[:2, :2], -b[:2, 1])
    values, vectors = np.linalg.eig(a[:2, :2])
    shares = np.linalg.solve(vectors, np.array([0.1, 0.0]) - trim)
    times = step * np.arange(50)
    exact = ((vectors * shares) @ np.exp(np.outer(values, times))).real.T + trim
    np.testing.assert_allclose(simulated[:, :2], exact, atol=1e-9)


def test_short_period_in_w_and_in_alpha_are_one() -> None:
    in_alpha, in_w = short_period(Steady(20.0)), short_period(Steady(20.0), vertical="w")
    inputs = steps(TIME, 0.5, 0.4, 0.05)[:, None]
    shared = {"M_q": -3.0, "M_delta": -20.0}
    a = in_alpha.simulate(
        vector(in_alpha, shared | {"Z_alpha": -2.0, "Z_q": -0.05, "M_alpha": -15.0}), np.zeros(2), inputs, 0.02
    )
    w = in_w.simulate(vector(in_w, shared | {"Z_w": -2.0, "Z_q": -1.0, "M_w": -0.75}), np.zeros(2), inputs, 0.02)
    np.testing.assert_allclose(w[:, 0], 20 * a[:, 0], atol=1e-12)
    np.testing.assert_allclose(w[:, 1:], a[:, 1:], atol=1e-10)


def test_the_vane_of_a_flight_at_an_angle_of_attack_is_that_of_its_velocity() -> None:
    """GIVEN small changes of u and w about 17 degrees THEN alpha changes as the direction of both does."""
    steady = Steady(20.0, alpha=0.3)
    model = longitudinal(steady)
    row = list(model.outputs).index("alpha") + len(model.states)
    told = dict(zip(model.states, model.constant[row], strict=False))
    u, w, small = 20.0 * np.cos(0.3), 20.0 * np.sin(0.3), 1e-6
    assert told["u"] == pytest.approx((np.arctan2(w, u + small) - 0.3) / small, rel=1e-5)
    assert told["alpha"] == pytest.approx((np.arctan2(w + 20.0 * small, u) - 0.3) / small, rel=1e-5)


def test_measured_sideslip_may_be_an_input() -> None:
    model = lateral(Steady(20.0, accelerometer_x=0.5), ("delta_a", "delta_r", "beta"), ("p", "r"))
    p = vector(model, {"L_beta": -12.0, "N_beta": 9.0, "N_0": 0.2})
    simulated = model.simulate(p, np.zeros(2), np.tile([0.0, 0.0, 0.1], (11, 1)), 0.1)
    outputs = dict(zip(model.outputs, simulated[-1], strict=True))
    assert outputs["p"] == pytest.approx(-1.2)
    assert outputs["r"] == pytest.approx(0.9 + 0.2)
    assert outputs["a_y"] == pytest.approx(0.5 * (0.9 + 0.2))


def test_nonlinear_flight_is_that_of_scipy() -> None:
    model = nonlinear_longitudinal(JET)
    p, time = vector(model, JET_TRUTH | {"C_D_k": 0.02, "C_L_q": 4.0, "C_L_delta": 0.3}), 0.1 * np.arange(101)
    inputs = np.column_stack((0.01 * np.sin(time) - 0.009, 12000 + 100 * time))
    start = np.array([105.0, 0.11, 0.11, 0.0])

    def rates(t: float, x: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
        out = np.empty(4)
        model.rates(x, np.array([np.interp(t, time, column) for column in inputs.T]), p, model.constants, out)
        return out

    theirs = solve_ivp(rates, (0, 10), start, t_eval=time, rtol=1e-9, atol=1e-10, max_step=0.1).y.T
    ours = model.simulate(p, start, inputs, 0.1)
    np.testing.assert_allclose(ours[:, 0], theirs[:, 0], atol=2e-4)
    np.testing.assert_allclose(ours[:, 2:4], theirs[:, 2:], atol=2e-6)


def test_energy_is_kept_without_air_and_thrust() -> None:
    model = nonlinear_longitudinal(JET)
    simulated = model.simulate(np.zeros(19), np.array([105.0, 0.0, 0.3, 0.0]), np.zeros((301, 2)), 0.01)
    speed, climb = simulated[:, 0], simulated[:, 0] * np.sin(simulated[:, 2] - simulated[:, 1])
    height = np.concatenate(([0.0], np.cumsum((climb[1:] + climb[:-1]) / 2 * 0.01)))
    np.testing.assert_allclose(speed**2 / 2 + JET.gravity * height, 105.0**2 / 2, rtol=1e-6)
    np.testing.assert_allclose(simulated[:, 5:], 0.0, atol=1e-12)


def test_sensors_off_the_centre_of_mass() -> None:
    near = nonlinear_longitudinal(JET._replace(accelerometer_x=0.0, vane_x=0.0))
    far = nonlinear_longitudinal(JET._replace(accelerometer_x=2.0, accelerometer_z=0.5, vane_x=5.0))
    p, start, inputs = vector(near, JET_TRUTH), np.array([105.0, 0.11, 0.11, 0.2]), np.tile([0.0, 12000.0], (9, 1))
    a, b = (dict(zip(m.outputs, m.simulate(p, start, inputs, 0.1)[0], strict=True)) for m in (near, far))
    assert b["alpha"] - a["alpha"] == pytest.approx(-5.0 * 0.2 / 105.0)
    assert b["a_x"] - a["a_x"] == pytest.approx(0.5 * a["q_dot"] - 2.0 * 0.04)
    assert b["a_z"] - a["a_z"] == pytest.approx(-2.0 * a["q_dot"] - 0.5 * 0.04)


def test_density_as_number_signal_or_dynamic_pressure_are_one() -> None:
    start, drive = np.array([105.0, 0.11, 0.11, 0.0]), np.tile([-0.009, 12000.0], (2, 1))
    first = []
    for density, column in ((0.8, None), ("density", 0.8), ("dynamic_pressure", 0.4 * 105.0**2)):
        model = nonlinear_longitudinal(JET._replace(density=density))
        inputs = drive if column is None else np.column_stack((drive, [column, column]))
        first.append(model.simulate(vector(model, JET_TRUTH), start, inputs, 0.1)[0])
    np.testing.assert_allclose(first[1], first[0])
    np.testing.assert_allclose(first[2], first[0])


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1, 0.137])
def test_a_held_elevator_is_that_of_a_fine_simulation_at_any_delay(delay: float) -> None:
    """At 10 Hz: the response to steps between samples; forces show the elevator as it is just before the sample."""
    inner, step, fine = short_period(Steady(8.0), vertical="alpha"), 0.1, 0.0005
    model = Actuated(inner, (Actuator(("delta_e",), "delay"),), zoh_inputs=("delta_e",))
    truth = {"Z_alpha": -4.0, "Z_delta": -0.6, "M_alpha": -40.0, "M_q": -5.0, "M_delta": -60.0}
    command = 0.1 * np.random.default_rng(5).integers(-1, 2, 60).astype(float)
    simulated = model.simulate(vector(model, truth | {"delay": delay}), np.zeros(2), command[:, None], step)
    time = np.arange(59 * round(step / fine) + 1) * fine
    acting = command[np.clip(np.ceil((time - delay) / step - 1e-6).astype(int) - 1, 0, 59)]
    expected = inner.simulate(vector(inner, truth), np.zeros(2), acting[:, None], fine)[:: round(step / fine)]
    off = np.abs(simulated - expected).max(axis=0) / np.ptp(expected, axis=0)
    assert np.all(off < 0.01), off


def test_a_held_input_of_a_nonlinear_model_steps_at_its_samples() -> None:
    inner = nonlinear_longitudinal(JET)
    start, steps_of = np.array([105.0, 0.11, 0.11, 0.0]), np.array([-0.009] * 5 + [-0.03] * 5 + [0.01] * 11)
    coarse = np.column_stack((steps_of, np.full(21, 12000.0)))
    held = Actuated(inner, (), zoh_inputs=("delta_e",)).simulate(vector(inner, JET_TRUTH), start, coarse, 0.1)
    fine = np.repeat(coarse, 200, axis=0)[: 20 * 200 + 1]
    exact = inner.simulate(vector(inner, JET_TRUTH), start, fine, 0.0005)[::200]
    states = [list(inner.outputs).index(name) for name in ("V", "alpha", "theta", "q")]
    off = np.abs(held - exact)[:, states].max(axis=0) / np.ptp(exact[:, states], axis=0)
    assert np.all(off < 0.005), off


def test_a_lag_and_a_delay_of_the_elevator_are_those_of_scipy_and_are_found() -> None:
    inner = short_period(Steady(20.0))
    model = actuated(inner, ("delta_e",))
    truth = {"Z_alpha": -2.0, "M_alpha": -15.0, "M_q": -3.0, "M_delta": -20.0}
    late = {"delay_delta_e": 0.06, "lag_delta_e": 0.05}
    inputs = steps(TIME, 0.5, 0.4, 0.05)[:, None]
    simulated = model.simulate(vector(model, truth | late), np.zeros(2), inputs, 0.02)
    _, behind, _ = lsim(([1.0], [0.05, 1.0]), np.concatenate((np.zeros(3), inputs[:-3, 0])), TIME)
    expected = inner.simulate(vector(inner, truth), np.zeros(2), np.asarray(behind)[:, None], 0.02)
    np.testing.assert_allclose(simulated, expected, atol=1e-9)
    noisy = simulated + noise(1, simulated.shape, 0.02 * simulated.std(axis=0))
    record = measured("late", TIME, model, noisy, inputs)
    free = {name: Parameter(0.8 * value) for name, value in truth.items()}
    free |= {name: Parameter(0.04, low=0.0, high=0.3) for name in late}
    fit = output_error(Problem(model, (record,), free, ("alpha", "q", "a_z")))
    assert covered(fit, truth | late) >= 5  # of 6
    with pytest.raises(InputError, match="no input flap"):
        actuated(inner, ("flap",))
