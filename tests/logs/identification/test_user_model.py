"""A user's own model: truth recovered, the numbers of the built-in model, and one line for every mistake."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from output_error_cases import SHORT_PERIOD, SHORT_PERIOD_TRUTH, noise, pitching, steps, vector

from groundstation.command import identify
from logs.identification.estimators.engine.problem import Nuisances, Parameter, Problem
from logs.identification.estimators.output_error import output_error
from logs.identification.models.compiled import CompiledModel
from logs.identification.models.user import load_user_model
from logs.identification.results import Array
from wingbeat.errors import InputError

NONLINEAR = """
states = {"alpha": "rad", "q": "rad/s"}
inputs = {"delta_e": "rad", "V": "m/s"}
outputs = {"alpha": "rad", "q": "rad/s", "a_z": "m/s^2"}
parameters = {
    "L_alpha": ("1/m", 0.05), "M_alpha": "1/m^2", "M_alpha3": ("1/m^2", 0.0), "M_q": "1/m",
    "M_delta": ("1/m^2", -0.03),
}
constants = {"trim": 0.0}

def lift(alpha, p):
    return p.L_alpha * alpha

def derivatives(x, u, p, c):
    moment = p.M_alpha * x.alpha + p.M_alpha3 * x.alpha**3 + p.M_delta * (u.delta_e - c.trim)
    return x.q - u.V * lift(x.alpha, p), u.V**2 * moment + p.M_q * u.V * x.q

def observations(x, u, p, c):
    return x.alpha, x.q, -u.V**2 * lift(x.alpha, p)
"""
TRUTH = {"L_alpha": 0.1, "M_alpha": -0.04, "M_alpha3": -1.0, "M_q": -0.15, "M_delta": -0.05}
LINEAR = """
states = {"alpha": "rad", "q": "rad/s", "theta": "rad"}
inputs = {"delta_e": "rad"}
outputs = {"alpha": "rad", "q": "rad/s", "theta": "rad"}
parameters = {
    "Z_alpha": "1/s", "Z_q": "-", "Z_delta": "1/s", "M_alpha": "1/s^2", "M_q": "1/s", "M_delta": "1/s^2",
}

def derivatives(x, u, p, c):
    alpha, q, theta = x
    return (
        p.Z_alpha * alpha + (1 + p.Z_q) * q + p.Z_delta * u.delta_e,
        p.M_alpha * alpha + p.M_q * q + p.M_delta * u.delta_e,
        q,
    )
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "my_model.py"
    path.write_text(text)
    return path


def record(model: CompiledModel, seed: int) -> tuple[Array, Array, Array]:
    """Time, inputs and outputs of a maneuver at a changing airspeed, with noise."""
    time = 0.02 * np.arange(600)
    inputs = np.column_stack((steps(time, 1.0, 0.5, 0.15), 20.0 + 2.0 * np.sin(0.7 * time)))
    clean = model.simulate(vector(model, TRUTH), np.zeros(2), inputs, 0.02)
    return time, inputs, clean + noise(seed, clean.shape, 0.05 * clean.std(axis=0))


def table(folder: Path, model: CompiledModel, seed: int) -> Path:
    time, inputs, outputs = record(model, seed)
    names = ["t", *model.inputs, *model.outputs]
    path = folder / "flight.csv"
    np.savetxt(path, np.column_stack((time, inputs, outputs)), delimiter=",", header=",".join(names), comments="")
    return path


MAP = """
[time]
column = "t"
[signals]
alpha = { column = "alpha", unit = "rad" }
q = { column = "q", unit = "rad/s" }
a_z = { column = "a_z", unit = "m/s^2" }
delta_e = { column = "delta_e", unit = "rad" }
V = { column = "V", unit = "m/s" }
"""


def identified(folder: Path, mapping: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    csv = table(folder, load_user_model(folder / "my_model.py").model, 3)
    (folder / "map.toml").write_text(MAP + mapping)
    subject = "aero" if "[[aero" in mapping else "modes"
    assert identify.run([str(csv), subject, "--map", str(folder / "map.toml"), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def test_parameters_of_a_nonlinear_model_are_within_their_intervals(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a cubic moment, and the measured airspeed as an input THEN a map with its file recovers the truth."""
    write(tmp_path, NONLINEAR)
    aero = '[[aero.output_error]]\nmodel = "my_model.py"\noutputs = ["alpha", "q", "a_z"]\n'
    (fit,) = identified(tmp_path, aero, capsys)["fits"]
    estimates = {one["name"]: one for one in fit["estimates"]}
    assert estimates.keys() == TRUTH.keys()
    for name, truth in TRUTH.items():
        assert estimates[name]["low"] <= truth <= estimates[name]["high"], name
        assert estimates[name]["value"] == pytest.approx(truth, rel=0.1)


@pytest.mark.validate
def test_modes_are_those_of_the_linearized_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, NONLINEAR)
    modes = '[modes]\nmodel = "my_model.py"\noutputs = ["alpha", "q", "a_z"]\n'
    methods = identified(tmp_path, modes, capsys)["modes"]["methods"]
    found = next(one for one in methods if one["method"] == "output error")
    z, m, damping, speed = TRUTH["L_alpha"], TRUTH["M_alpha"], TRUTH["M_q"], 20.0
    frequency = speed * np.sqrt(-m - z * damping)
    assert found["frequency"]["value"] == pytest.approx(frequency, rel=0.03)


def test_numbers_are_those_of_the_built_in_model(tmp_path: Path) -> None:
    """GIVEN the short period written as a file THEN the same estimates and errors as the matrices give."""
    user = load_user_model(write(tmp_path, LINEAR)).model
    outputs, experiment = ("alpha", "q", "theta"), pitching(3)
    starts = {name: Parameter(0.7 * value) for name, value in SHORT_PERIOD_TRUTH.items()}
    fits = [
        output_error(Problem(model, (experiment,), starts, outputs, Nuisances(output_biases=("alpha", "q"))))
        for model in (SHORT_PERIOD, user)
    ]
    first, second = ([(one.value, one.standard_error) for one in fit.estimates] for fit in fits)
    assert len(first) == 6
    np.testing.assert_allclose(second, first, rtol=1e-4)


def test_what_numba_cannot_compile_runs_as_python(tmp_path: Path) -> None:
    compiled = load_user_model(write(tmp_path, NONLINEAR))
    text = NONLINEAR.replace("return p.L_alpha * alpha", 'return float(f"{p.L_alpha * alpha:.17g}")')
    plain = load_user_model(write(tmp_path, text))
    assert not compiled.findings
    assert [one.code for one in plain.findings] == ["model_not_compiled"]
    assert "my_model.py runs as plain Python" in plain.findings[0].text
    inputs = np.column_stack((np.full(100, 0.1), np.full(100, 20.0)))
    p = vector(compiled.model, TRUTH)
    ours = plain.model.simulate(p, np.zeros(2), inputs, 0.02)
    np.testing.assert_allclose(ours, compiled.model.simulate(p, np.zeros(2), inputs, 0.02), rtol=1e-12)


def test_a_function_outside_its_range_gives_no_number(tmp_path: Path) -> None:
    """GIVEN the root of what becomes negative THEN NaN, compiled or not, and no exception."""
    text = """
import math
states = {"h": ("m", 1.0)}
outputs = {"h": "m"}
parameters = {"k": ("1/s", 1.0)}
def derivatives(x, u, p, c):
    return (-p.k - math.sqrt(x.h),)
"""
    for version in (text, text.replace("(-p.k", '(-float(f"{p.k}")')):
        model = load_user_model(write(tmp_path, version)).model
        outputs = model.simulate(np.array([1.0]), np.array([1.0]), np.zeros((100, 0)), 0.05)
        assert np.isfinite(outputs[0, 0])
        assert np.isnan(outputs[-1, 0])


def test_constants_of_the_map_replace_those_of_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, NONLINEAR)
    assert load_user_model(path).model.constants == pytest.approx([0.0])
    assert load_user_model(path, {"trim": 0.02, "mass": 1.0}).model.constants == pytest.approx([0.02])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("def derivatives", "def derivative", "derivatives is missing"),
        ('"q": "rad/s"}\ninputs', '"q": 3}\ninputs', r"states\['q'\] must be a unit"),
        ('"V": "m/s"}', '"air speed": "m/s"}', r"inputs\['air speed'\]: a name has letters"),
        ('"V": "m/s"}', '"q": "rad/s"}', "q is a state and an input"),
        ("p.M_alpha3", "p.M_alpha2", r"line 15: AttributeError: 'p' object has no attribute 'M_alpha2'"),
        ("return x.alpha, x.q, -u", "return x.q, -u", "observations returns 2 values for 3 names: alpha, q, a_z"),
        ("def lift(alpha, p):", "def lift(alpha, p)", "line 11: expected ':'"),
        ("def observations", "def observation", "output a_z is no state: define observations"),
        ('"trim": 0.0', '"trim": "none"', r"constants\['trim'\] must be a number in SI, not 'none'"),
    ],
)
def test_a_mistake_in_the_file_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in NONLINEAR
    path = write(tmp_path, NONLINEAR.replace(old, new))
    with pytest.raises(InputError, match=message) as error:
        load_user_model(path)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(f"model {path}")


def test_a_mistake_in_the_map_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, NONLINEAR)
    aero = '[[aero.output_error]]\nmodel = "my_model.py"\noutputs = ["alpha", "q"]\ninputs = ["delta_e"]\n'
    with pytest.raises(InputError, match=r"the inputs of my_model.py are delta_e, V; leave the key out"):
        identified(tmp_path, aero, capsys)
    with pytest.raises(InputError, match=r"cannot read model .*other.py: No such file"):
        identified(tmp_path, aero.replace("my_model", "other"), capsys)
