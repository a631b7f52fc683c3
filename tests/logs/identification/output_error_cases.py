"""Aircraft with known derivatives, flown and measured with noise: what the tests of output error fit."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Fit, Model, Parameter
from logs.identification.models.linear import LinearModel
from logs.identification.models.nonlinear_longitudinal import Airframe, nonlinear_longitudinal
from logs.identification.models.stability import Steady, lateral, longitudinal, short_period
from logs.identification.results import Array

SHORT_PERIOD = short_period(Steady(20.0), pitch=True)
SHORT_PERIOD_TRUTH = {
    "Z_alpha": -2.0, "Z_q": -0.05, "Z_delta": -0.2, "M_alpha": -15.0, "M_q": -3.0, "M_delta": -20.0,
}  # fmt: skip
LONGITUDINAL = longitudinal(Steady(20.0, pitch=0.06, alpha=0.06))
LONGITUDINAL_TRUTH = {
    "X_u": -0.1, "X_alpha": 3.0, "Z_u": -0.9, "Z_alpha": -45.0, "Z_delta": -4.0,
    "M_alpha": -15.0, "M_q": -3.0, "M_delta": -20.0,
}  # fmt: skip
LATERAL = lateral(Steady(20.0, pitch=0.06, alpha=0.06))
LATERAL_TRUTH = {
    "Y_beta": -8.0, "Y_delta_r": 2.0, "L_beta": -12.0, "L_p": -6.0, "L_r": 1.5, "L_delta_a": 40.0,
    "N_beta": 9.0, "N_p": -0.4, "N_r": -1.0, "N_delta_r": -8.0,
}  # fmt: skip
JET = Airframe(
    mass=7500.0, inertia_y=73000.0, area=30.0, chord=2.4, airspeed=105.0, density=0.8, thrust_inclination=0.05,
    thrust_arm=-0.4, accelerometer_x=0.8, vane_x=5.0,
)  # fmt: skip
JET_TRUTH = {
    "C_D_0": 0.12, "C_D_V": -0.065, "C_D_alpha": 0.32, "C_L_0": -0.09, "C_L_V": 0.15, "C_L_alpha": 4.3,
    "C_m_0": 0.11, "C_m_V": 0.004, "C_m_alpha": -0.97, "C_m_q": -35.0, "C_m_delta": -1.5,
}  # fmt: skip


def steps(time: Array, at: float, unit: float, size: float) -> Array:
    """A 3-2-1-1 input that begins at ``at``, its shortest step ``unit`` s long."""
    edges = at + unit * np.array([0.0, 3.0, 5.0, 6.0, 7.0])
    signs = size * np.array([1.0, -1.0, 1.0, -1.0])
    return np.sum(
        [s * ((time >= a) & (time < b)) for s, a, b in zip(signs, edges[:-1], edges[1:], strict=True)], axis=0
    )


def vector(model: Model, truth: dict[str, float]) -> Array:
    return np.array([truth.get(name, named.value) for name, named in model.parameters.items()])


def parameters(truth: dict[str, float], factor: float = 0.6) -> dict[str, Parameter]:
    return {name: Parameter(factor * value) for name, value in truth.items()}


def noise(seed: int, shape: tuple[int, int], deviations: Array, pole: float = 0.0) -> Array:
    """White, or coloured by one pole; of the same standard deviation."""
    white = np.random.default_rng(seed).normal(size=(shape[0] + 200, shape[1]))
    colored = lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], white, axis=0)[200:]
    return np.asarray(colored * deviations)


def measured(name: str, time: Array, model: Model, outputs: Array, inputs: Array) -> Experiment:
    signals = dict(zip(model.outputs, outputs.T, strict=True)) | dict(zip(model.inputs, inputs.T, strict=True))
    return Experiment(name, time, signals, dict(model.outputs) | dict(model.inputs))


def simulated(
    model: LinearModel,
    truth: dict[str, float],
    inputs: Array,
    step: float,
    share: float,
    seed: int,
    pole: float = 0.0,
) -> Experiment:
    """A linear model's record with noise of a ``share`` of each output's motion."""
    clean = model.simulate(vector(model, truth), np.zeros(len(model.states)), inputs, step)
    raw = clean + noise(seed, clean.shape, share * clean.std(axis=0), pole)
    return measured(f"record {seed}", step * np.arange(len(inputs)), model, raw, inputs)


def pitching(seed: int, pole: float = 0.0, count: int = 500, step: float = 0.02, size: float = 0.06) -> Experiment:
    """A short-period manoeuvre of `SHORT_PERIOD`."""
    time = step * np.arange(count)
    return simulated(SHORT_PERIOD, SHORT_PERIOD_TRUTH, steps(time, 1.0, 0.4, size)[:, None], step, 0.05, seed, pole)


def jet(seed: int) -> Experiment:
    """45 s of the jet of `JET` at 10 Hz: a 3-2-1-1, a push for the phugoid, and a change of thrust."""
    model, time = nonlinear_longitudinal(JET), 0.1 * np.arange(450)
    alpha, thrust, elevator = 0.1112, 11800.0, -0.0088
    elevators = elevator + steps(time, 2.0, 1.0, 0.02) - 0.01 * ((time > 14) & (time < 24))
    inputs = np.column_stack((elevators, thrust * (1 + 0.1 * ((time > 18) & (time < 32)))))
    clean = model.simulate(vector(model, JET_TRUTH), np.array([105.0, alpha, alpha, 0.0]), inputs, 0.1)
    deviations = np.array([0.3, 0.002, 0.001, 0.001, 0.004, 0.02, 0.08])
    return measured(f"jet {seed}", time, model, clean + noise(seed, clean.shape, deviations), inputs)


def covered(fit: Fit, truth: dict[str, float]) -> int:
    """How many of the estimates hold the truth; the fit must be whole."""
    assert fit.status == "converged", fit.failure
    assert not fit.withheld
    assert {e.name for e in fit.estimates} == set(truth)
    return sum(e.contains(truth[e.name]) for e in fit.estimates)
