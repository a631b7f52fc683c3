"""Output error says what it cannot give, and refuses what makes no sense in one line."""

from __future__ import annotations

import numpy as np
import pytest
from output_error_cases import (
    JET,
    JET_TRUTH,
    SHORT_PERIOD,
    SHORT_PERIOD_TRUTH,
    jet,
    parameters,
    pitching,
)

from logs.identification.estimators.engine.problem import Fit, Named, Nuisances, Parameter, Problem, window
from logs.identification.estimators.output_error import Search, output_error
from logs.identification.models.linear import ONE, Term, linear_model
from logs.identification.models.nonlinear_longitudinal import nonlinear_longitudinal
from logs.identification.models.stability import Steady, lateral, short_period
from wingbeat.errors import InputError

SHORT = ("alpha", "q", "theta", "a_z")
PROBLEM = Problem(SHORT_PERIOD, (pitching(1),), parameters(SHORT_PERIOD_TRUTH), SHORT)


def lost(fit: Fit) -> dict[str, str]:
    return {one.subject: one.text for one in fit.withheld}


def test_a_parameter_without_effect_is_named() -> None:
    two = short_period(Steady(20.0), inputs=("delta_e", "flap"))
    record = pitching(1)
    still = record._replace(signals=dict(record.signals) | {"flap": np.zeros(500)})
    truth = {name.replace("_delta", "_delta_e"): value for name, value in SHORT_PERIOD_TRUTH.items()}
    fit = output_error(Problem(two, (still,), parameters(truth) | {"M_flap": Parameter(-1.0)}, ("alpha", "q")))
    assert lost(fit) == {"M_flap": "it has no effect on the fitted outputs"}
    assert {e.name for e in fit.estimates} == set(truth)
    assert sum(e.contains(truth[e.name]) for e in fit.estimates) >= 5


def test_parameters_that_act_alike_are_named_together() -> None:
    two = short_period(Steady(20.0), inputs=("delta_e", "flap"))
    record = pitching(1)
    geared = record._replace(signals=dict(record.signals) | {"flap": 0.5 * record.signals["delta_e"]})
    truth = {name.replace("_delta", "_delta_e"): value for name, value in SHORT_PERIOD_TRUTH.items()}
    fit = output_error(Problem(two, (geared,), parameters(truth) | {"M_flap": Parameter(-1.0)}, ("alpha", "q")))
    assert lost(fit) == {
        "M_delta_e": "the data does not determine it apart from M_flap",
        "M_flap": "the data does not determine it apart from M_delta_e",
    }
    assert sum(e.contains(truth[e.name]) for e in fit.estimates) >= 4


def test_a_parameter_that_mimics_a_bias_is_named() -> None:
    model = linear_model(
        {"x": Named("m")}, {"u": "m"}, {"a": Named("1/s"), "b": Named("1/s"), "c": Named("m")},
        {"x": (Term("x", "a"), Term("u", "b"))}, {"x": ("m", (Term("x"), Term(ONE, "c")))},
    )  # fmt: skip
    time = np.arange(400) * 0.05
    inputs = np.sin(time**1.5)[:, None]
    clean = model.simulate(np.array([-1.0, 2.0, 0.3]), np.zeros(1), inputs, 0.05)[:, 0]
    noisy = clean + 0.01 * np.random.default_rng(0).normal(size=400)
    record = pitching(1)._replace(time=time, signals={"x": noisy, "u": inputs[:, 0]})
    free = {"a": Parameter(-0.5), "b": Parameter(1.0), "c": Parameter(0.1)}
    biased = Nuisances(output_biases=("x",))
    fit = output_error(Problem(model, (record,), free, ("x",), biased))
    assert lost(fit) == {"c": "the data does not determine it apart from the initial states and biases"}
    without = output_error(Problem(model, (record,), free | {"c": Parameter(0.1, free=False)}, ("x",), biased))
    for one, other in zip(fit.estimates, without.estimates, strict=True):
        assert one.value == pytest.approx(other.value, abs=0.01 * other.standard_error)
        assert one.standard_error == pytest.approx(other.standard_error, rel=0.02)


def test_without_excitation_nothing_is_printed() -> None:
    time = 0.02 * np.arange(200)
    noise = np.random.default_rng(1).normal(size=(200, 4)) * 0.01
    signals = dict(zip(SHORT, noise.T, strict=True)) | {"delta_e": np.zeros(200)}
    fit = output_error(PROBLEM._replace(experiments=(pitching(1)._replace(time=time, signals=signals),)))
    assert not {e.name for e in fit.estimates} & {"Z_delta", "M_delta"}
    assert fit.failure or {"Z_delta", "M_delta"} <= set(lost(fit))


def test_a_manoeuvre_below_the_noise_gives_nothing() -> None:
    short = window(pitching(2, size=2e-4), 0.9, 1.4)
    for seed in range(3):
        rng = np.random.default_rng(seed)
        noisy = {name: short.signals[name] + 0.05 * rng.normal(size=len(short.time)) for name in SHORT}
        fit = output_error(PROBLEM._replace(experiments=(short._replace(signals=dict(short.signals) | noisy),)))
        assert fit.failure and not fit.estimates


def test_a_wide_interval_is_a_finding() -> None:
    """A fast doublet within 0.12 s moves the outputs well, but does not tell the slow derivatives apart."""
    record = window(pitching(2, step=0.002, count=2000), 0.99, 1.11)
    rng = np.random.default_rng(3)
    noisy = {name: record.signals[name] + 0.02 * rng.normal(size=len(record.time)) for name in ("alpha", "q")}
    fit = output_error(PROBLEM._replace(experiments=(record._replace(signals=dict(record.signals) | noisy),)))
    for estimate in fit.estimates:
        assert estimate.contains(SHORT_PERIOD_TRUTH[estimate.name])
    assert fit.failure or any(one.code == "wide_interval" for one in fit.findings)


def test_a_start_that_diverges_is_said() -> None:
    wild = parameters(SHORT_PERIOD_TRUTH) | {"M_alpha": Parameter(3e4)}
    fit = output_error(PROBLEM._replace(parameters=wild))
    assert fit.status == "diverged"
    assert "diverges" in fit.failure and "record 1" in fit.failure
    assert not fit.estimates and np.all(np.isnan(fit.values))
    model = nonlinear_longitudinal(JET)
    falling = parameters(JET_TRUTH) | {"C_m_alpha": Parameter(9.0)}
    assert output_error(Problem(model, (jet(0),), falling, tuple(model.outputs))).status == "diverged"


def test_too_few_steps_are_not_called_converged() -> None:
    fit = output_error(PROBLEM, Search(steps=1, fallback=False))
    assert fit.status == "not converged"
    assert fit.failure == "not converged after 1 steps"
    assert not fit.estimates


def test_a_parameter_at_its_bound_has_no_interval() -> None:
    bounded = parameters(SHORT_PERIOD_TRUTH) | {"M_q": Parameter(-1.0, low=-2.0, high=0.0)}
    fit = output_error(PROBLEM._replace(parameters=bounded))
    assert lost(fit)["M_q"] == "it stays at its bound -2"


def test_a_record_without_noise_converges() -> None:
    record = pitching(1)
    inputs = record.signals["delta_e"][:, None]
    truth = np.array([SHORT_PERIOD_TRUTH.get(name, 0.0) for name in SHORT_PERIOD.parameters])
    clean = SHORT_PERIOD.simulate(truth, np.zeros(3), inputs, 0.02)
    signals = dict(zip(SHORT_PERIOD.outputs, clean.T, strict=True)) | {"delta_e": inputs[:, 0]}
    fit = output_error(PROBLEM._replace(experiments=(record._replace(signals=signals),)))
    assert fit.status == "converged"
    np.testing.assert_allclose([e.value for e in fit.estimates], list(SHORT_PERIOD_TRUTH.values()), rtol=1e-5)


def with_signal(name: str, values: np.ndarray | None) -> Problem:  # type: ignore[type-arg]
    record = PROBLEM.experiments[0]
    signals = {key: value for key, value in record.signals.items() if key != name}
    if values is not None:
        signals[name] = values
    return PROBLEM._replace(experiments=(record._replace(signals=signals),))


def gap(name: str, count: int) -> np.ndarray:  # type: ignore[type-arg]
    values = PROBLEM.experiments[0].signals[name].copy()
    values[:count] = np.nan
    return np.asarray(values)


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (with_signal("delta_e", gap("delta_e", 3)), "input delta_e lacks 3 samples"),
        (with_signal("delta_e", None), "the input delta_e is not among its signals"),
        (with_signal("q", None), "the output q is not among its signals"),
        (with_signal("q", gap("q", 500)), "output q has no sample"),
        (PROBLEM._replace(experiments=()), "no maneuver"),
        (PROBLEM._replace(outputs=()), "no output"),
        (PROBLEM._replace(outputs=("alpha", "speed")), "no output speed"),
        (PROBLEM._replace(parameters={"M_w": Parameter(1.0)}), "no parameter M_w"),
        (PROBLEM._replace(parameters={"M_q": Parameter(1.0, free=False)}), "no free parameter"),
        (PROBLEM._replace(parameters={"M_q": Parameter(1.0, high=0.0)}), "outside its bounds"),
        (PROBLEM._replace(parameters={"M_q": Parameter(np.nan)}), "not a number"),
        (PROBLEM._replace(nuisances=Nuisances(output_biases=("V",))), "bias of V"),
        (PROBLEM._replace(weighting="given"), "no positive standard deviation for alpha"),
        (PROBLEM._replace(initial=({}, {})), "initial states for 2 of 1"),
    ],
)
def test_nonsense_is_refused_in_a_line(problem: Problem, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        output_error(problem)
    assert "\n" not in str(caught.value)


def test_uneven_time_and_short_records_are_refused() -> None:
    record = PROBLEM.experiments[0]
    late = record.time.copy()
    late[250:] += 0.01
    with pytest.raises(InputError, match="not equally spaced"):
        output_error(PROBLEM._replace(experiments=(record._replace(time=late),)))
    with pytest.raises(InputError, match="too few"):
        output_error(PROBLEM._replace(experiments=(window(record, 1.0, 1.1),)))
    with pytest.raises(InputError, match="fewer than two samples"):
        window(record, 100.0, 101.0)


def test_models_that_cannot_be_are_refused() -> None:
    with pytest.raises(InputError, match="positive airspeed"):
        short_period(Steady(0.0))
    with pytest.raises(InputError, match="states beta, p, r, phi"):
        lateral(Steady(20.0), states=("q",))
    with pytest.raises(InputError, match="mass must be positive"):
        nonlinear_longitudinal(JET._replace(mass=0.0))
    with pytest.raises(InputError, match="density"):
        nonlinear_longitudinal(JET._replace(density="thin"))
