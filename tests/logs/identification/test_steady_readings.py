"""Steady bench readings: rows are independent, their order means nothing."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from groundstation.command.main import main
from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import Settings, coefficient_regression
from logs.identification.estimators.stepwise import stepwise_regression
from logs.identification.sources.table.run import identify_tables
from logs.identification.statistics.fit_quality import output_fits
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


SERVO = {"K_tau": 0.78, "K_tau0": -0.29}
POWER = {"C_B": 5.0, "C_C": 1.2, "C_F": 0.9, "C_G": -1.2}
"""Gerdes Eq. 12 about the mean current and voltage of the readings"""
BENCH = """
[experiment]
kind = "steady"
[signals]
torque = { column = "torque", unit = "N m" }
current = { column = "I", unit = "A" }
voltage = { column = "U", unit = "V" }
power = { column = "P", unit = "W" }
[maneuvers]
rows = [[1, 100], [101, 140]]
validate = [2]
[servo]
[power]
"""


def bench(seed: int) -> dict[str, np.ndarray]:
    """140 readings of one servo; the means of the first 100 are the center of the power model."""
    rng = np.random.default_rng(seed)
    i, u = rng.uniform(0.6, 3.5, 140), rng.choice([6.0, 6.6, 7.4, 8.0], 140)
    a, b = i - i[:100].mean(), u - u[:100].mean()
    power = 12.0 + 5.0 * a + 1.2 * b + 0.9 * a * b - 1.2 * a**2
    noise = rng.normal(size=(2, 140))
    return {"I": i, "U": u, "P": power + 0.05 * noise[0], "torque": 0.78 * i - 0.29 + 0.01 * noise[1]}


def test_servo_torque_and_power_come_from_a_bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN steady readings of a servo THEN Gerdes' coefficients are inside, and held-out readings are predicted."""
    (tmp_path / "map.toml").write_text(BENCH)
    hits: dict[str, list[bool]] = {}
    for seed in range(10):
        path = write(tmp_path / "bench.csv", bench(seed))
        for subject, truth in (("servo", SERVO), ("power", POWER)):
            assert main(["identify", str(path), "--map", str(tmp_path / "map.toml"), subject, "--json"]) == 0
            (fit,) = json.loads(capsys.readouterr().out)["fits"]
            found = {one["name"]: one for one in fit["estimates"]}
            for name, value in truth.items():
                hits.setdefault(name, []).append(found[name]["low"] <= value <= found[name]["high"])
                assert found[name]["high"] - found[name]["low"] < 0.2 * abs(value)
            assert [one["held_out"] for one in fit["outputs"]] == [False, True]
            assert fit["outputs"][1]["theil"] < 0.02
    assert all(np.mean(inside) >= 0.8 for inside in hits.values()), hits


@pytest.mark.parametrize("subject", ["servo", "power"])
def test_the_example_maps_are_read(tmp_path: Path, subject: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "--map-example", subject]) == 0
    (tmp_path / "map.toml").write_text(capsys.readouterr().out)
    path = write(tmp_path / "bench.csv", bench(1))
    assert main(["identify", str(path), "--map", str(tmp_path / "map.toml"), subject, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["fits"][0]["subject"] == subject


def test_motion_is_refused_for_steady_readings(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP.replace("RESPONSE", "P") + '\n[modes]\ninputs = ["I"]\noutputs = ["U"]\n')
    with pytest.raises(InputError, match=r"\[modes\] needs a motion"):
        identify_tables([write(tmp_path / "bench.csv", readings(1))], tmp_path / "map.toml", "modes")


def test_steady_residuals_have_no_whiteness(tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(MAP.replace("RESPONSE", "P"))
    (fit,) = identify_tables([write(tmp_path / "bench.csv", readings(1))], tmp_path / "map.toml", "aero").fits
    assert [one.white for one in output_fits(fit.series)] == [None]
