"""Steady bench readings: rows are independent, their order means nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import Settings, coefficient_regression
from logs.identification.estimators.stepwise import stepwise_regression
from logs.identification.tables.run import identify_tables
from wingbeat.errors import InputError

MAP = """
[experiment]
kind = "steady"
[signals]
I = { column = "I", unit = "A" }
U = { column = "U", unit = "V" }
P = { column = "P", unit = "W" }
[[aero.regressions]]
response = "RESPONSE"
regressors = ["I", "U", "I*U", "I^2"]
"""
TRUTH = {"intercept": 3.0, "I": -4.0, "U": 1.5, "I*U": 0.9, "I^2": -1.2}


def readings(seed: int) -> dict[str, np.ndarray]:
    """120 readings of a power of second order in current and voltage, in any order."""
    rng = np.random.default_rng(seed)
    i, u = rng.uniform(0.6, 3.5, 120), rng.choice([6.0, 6.6, 7.4, 8.0], 120)
    power = 3.0 - 4.0 * i + 1.5 * u + 0.9 * i * u - 1.2 * i**2 + 0.05 * rng.normal(size=120)
    return {"I": i, "U": u, "P": power}


def write(path: Path, columns: dict[str, np.ndarray]) -> Path:
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.mark.parametrize("order", ["random", "sorted"])
def test_intervals_are_those_of_ordinary_least_squares(tmp_path: Path, order: str) -> None:
    columns = readings(1)
    if order == "sorted":
        columns = {name: values[np.argsort(columns["I"])] for name, values in columns.items()}
    (tmp_path / "map.toml").write_text(MAP.replace("RESPONSE", "P"))
    (fit,) = identify_tables([write(tmp_path / "bench.csv", columns)], tmp_path / "map.toml", "aero").fits
    i, u = columns["I"], columns["U"]
    x = np.column_stack((np.ones(120), i, u, i * u, i**2))
    values, (squares,), *_ = np.linalg.lstsq(x, columns["P"], rcond=None)
    errors = np.sqrt(np.diag(np.linalg.inv(x.T @ x)) * squares / 115)
    for one, value, error in zip(fit.estimates, values, errors, strict=True):
        assert one.value == pytest.approx(value, rel=1e-5)
        assert one.standard_error == pytest.approx(error, rel=1e-3)
        assert one.contains(TRUTH[one.name])


def test_stepwise_regression_counts_every_reading() -> None:
    columns = readings(2)
    one = Experiment("bench", np.arange(120.0), columns, {"I": "A", "U": "V", "P": "W"}, steady=True)
    found = stepwise_regression((one,), "P", ("I", "U", "I*U", "I^2", "U^2"), settings=Settings(steady=True))
    assert set(found.terms) >= {"I*U", "I^2"} and found.independent == 120.0
    uneven = one._replace(time=np.cumsum(np.random.default_rng(1).uniform(size=120)))
    assert coefficient_regression((uneven,), "P", ("I",), "time", Settings(steady=True)).samples == 120


def test_steady_readings_have_no_derivative(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(
        MAP.replace("RESPONSE", "q_dot").replace("P = {", "q = {").replace('"W"', '"rad/s"')
    )
    with pytest.raises(InputError, match="no derivatives"):
        identify_tables([write(tmp_path / "bench.csv", readings(3))], tmp_path / "map.toml", "aero")
