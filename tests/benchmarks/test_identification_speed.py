"""How fast output error is, beside scipy's least squares on scipy's simulation (``make bench``)."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from rows import Row, leave, peer
from scipy.optimize import least_squares
from scipy.signal import lsim

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Parameter, Problem
from logs.identification.estimators.output_error import output_error
from logs.identification.models.stability import Steady, short_period
from logs.identification.results import Array

LIMIT_S = 0.050
TIMES_FASTER = 10.0
STEP, COUNT = 0.02, 1250
TRUTH = {
    "Z_alpha": -2.0, "Z_q": -0.05, "Z_delta": -0.2, "Z_0": 0.02, "M_alpha": -15.0, "M_q": -3.0, "M_delta": -20.0,
    "M_0": -0.1,
}  # fmt: skip
MODEL = short_period(Steady(20.0))
OUTPUTS = ("alpha", "q", "a_z")


def record() -> Experiment:
    at = STEP * np.arange(COUNT)
    elevator = 0.05 * np.sign(np.sin(2 * np.pi * 0.3 * at * (1 + at / 20)))
    truth = np.array([TRUTH[name] for name in MODEL.parameters])
    clean = dict(zip(MODEL.outputs, MODEL.simulate(truth, np.zeros(2), elevator[:, None], STEP).T, strict=True))
    rng = np.random.default_rng(1)
    noisy = {name: clean[name] + 0.05 * clean[name].std() * rng.normal(size=COUNT) for name in OUTPUTS}
    return Experiment("bench", at, noisy | {"delta_e": elevator}, {})


def fastest(of: Callable[[], object], times: int) -> float:
    """s; of the processor, the least of several runs."""
    spent = []
    for _ in range(times):
        begun = time.process_time()
        of()
        spent.append(time.process_time() - begun)
    return min(spent)


def with_scipy(experiment: Experiment, deviations: Array) -> Array:
    """The same parameters by scipy's least squares on scipy's exact simulation of linear systems."""
    inputs = np.column_stack((experiment.signals["delta_e"], np.ones(COUNT)))
    wanted = np.column_stack([experiment.signals[name] for name in OUTPUTS])
    rows = [list(MODEL.outputs).index(name) for name in OUTPUTS]

    def rest(free: Array) -> Array:
        a, b, c, d = MODEL.matrices(free[:8])
        _, flown, _ = lsim((a, b, c[rows], d[rows]), inputs, experiment.time, free[8:])
        return np.asarray(((wanted - flown) / deviations).ravel())

    start = np.concatenate(([0.7 * TRUTH[name] for name in MODEL.parameters], np.zeros(2)))
    return np.asarray(least_squares(rest, start, x_scale=np.maximum(np.abs(start), 0.1)).x[:8])


@pytest.mark.bench
def test_eight_parameters_of_1250_samples() -> None:
    experiment = record()
    problem = Problem(MODEL, (experiment,), {n: Parameter(0.7 * v) for n, v in TRUTH.items()}, OUTPUTS)
    fit = output_error(problem)
    assert len(fit.estimates) == 8, fit.failure
    computed = fastest(lambda: output_error(problem), 10)
    begun = time.process_time()
    theirs = with_scipy(experiment, np.sqrt(np.diag(fit.noise)))
    scipys = time.process_time() - begun
    print(f"output error: {1e3 * computed:.1f} ms, scipy: {1e3 * scipys:.0f} ms")  # noqa: T201
    what, requested = "output error, 8 parameters, 1250 samples", f"at most {1e3 * LIMIT_S:g}"
    leave(Row(what, 1e3 * computed, 1e3 * scipys, "ms", f"{peer('scipy')}, least_squares on lsim", requested))
    errors = np.array([fit.estimates[list(fit.names).index(name)].standard_error for name in MODEL.parameters])
    values = np.array([fit.estimates[list(fit.names).index(name)].value for name in MODEL.parameters])
    np.testing.assert_array_less(np.abs(values - theirs), 0.5 * errors)
    assert computed < LIMIT_S
    assert scipys > TIMES_FASTER * computed
