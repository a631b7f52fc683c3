"""A channel that does not move is named: no numbers are made of it, and no search runs away for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from logs.identification.results import EstimationResult
from logs.identification.sources.table.run import identify_tables
from tests.logs.identification.test_tables_identified import BASE, codes, flight, numbers, write
from wingbeat.errors import InputError

REGRESSION = """
[time]
column = "t"
[signals]
q = { column = "q", unit = "rad/s" }
alpha = { column = "alpha", unit = "rad" }
V = { column = "V", unit = "m/s" }
C = { column = "C", unit = "-" }
[constants]
c = 2.0
[[aero.regressions]]
response = "C"
regressors = ["alpha", "q*c/2V"]
"""


@pytest.mark.parametrize("more", ["", "vane_x = 6\n"])
def test_an_output_that_never_moves_is_refused_by_its_name(tmp_path: Path, more: str) -> None:
    """GIVEN an angle of attack that is one number THEN that is said, also where a vane's place moves it with q."""
    columns = flight()
    columns["alpha"] = np.full(len(columns["t"]), 0.05)
    (tmp_path / "map.toml").write_text(BASE.replace("V = 100\n", f"V = 100\n{more}"))
    with pytest.raises(InputError, match=r"^alpha is constant in run\.csv: .* is it the wrong column\?"):
        identify_tables([write(tmp_path / "run.csv", columns)], tmp_path / "map.toml", "modes")


def test_a_file_with_an_of_in_its_name_is_called_by_all_of_it(tmp_path: Path) -> None:
    columns = flight()
    (tmp_path / "map.toml").write_text(BASE)
    file = write(tmp_path / "log of day.csv", columns | {"alpha": np.full(len(columns["t"]), 0.05)})
    with pytest.raises(InputError, match=r"^alpha is constant in log of day\.csv:"):
        identify_tables([file], tmp_path / "map.toml", "modes")


def test_an_output_that_froze_in_one_of_two_manoeuvres_is_named(tmp_path: Path) -> None:
    columns = flight()
    frozen = columns | {"q": np.full(len(columns["t"]), 0.01)}
    (tmp_path / "map.toml").write_text(BASE + 'states = 2\nmethod = "output_error"\n')
    files = [write(tmp_path / f"{name}.csv", one) for name, one in (("one", columns), ("two", frozen))]
    told = identify_tables(files, tmp_path / "map.toml", "modes").fits[0].warnings
    frozen_q = [one for one in told if one.code == "frozen_signal"]
    assert [(one.subject, one.details["where"]) for one in frozen_q] == [("q", "maneuver 2 of two.csv")]
    (whole,) = identify_tables(files[:1], tmp_path / "map.toml", "modes").fits
    assert "frozen_signal" not in codes(whole)


def regressed(folder: Path, moves: bool, angles: bool = True, mapping: str = REGRESSION) -> EstimationResult:
    """C = 0.1 + 3 alpha - 8 q c/(2 V) while V falls; q that ``moves`` or not, alpha as the ``angles`` say."""
    rng, t = np.random.default_rng(2), 0.02 * np.arange(1000)
    alpha = 0.1 * np.sin(1.1 * t) if angles else np.full(1000, 0.02)
    q = 0.2 * np.sin(2.3 * t) if moves else np.full(1000, 0.03)
    speed = 100.0 - t
    force = 0.1 + 3.0 * alpha - 8.0 * q / speed + rng.normal(0.0, 0.001, 1000)
    (folder / "map.toml").write_text(mapping)
    table = write(folder / "run.csv", {"t": t, "q": q, "alpha": alpha, "V": speed, "C": force})
    (fit,) = identify_tables([table], folder / "map.toml", "aero").fits
    return fit


def test_a_rate_that_never_moves_has_no_coefficient_though_the_airspeed_moves(tmp_path: Path) -> None:
    still, moving = (regressed(tmp_path, moves) for moves in (False, True))
    (lost,) = still.withheld
    assert (lost.subject, lost.code) == ("q*c/2V", "constant_signal")
    assert numbers(still)["alpha"].value == pytest.approx(3.0, rel=0.01)
    assert numbers(moving)["q*c/2V"].contains(-8.0) and not moving.withheld


def test_a_regression_of_nothing_that_moves_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"alpha is constant in run\.csv.*q\*c/2V is constant in run\.csv"):
        regressed(tmp_path, moves=False, angles=False)
    made = REGRESSION.replace('response = "C"', 'response = "C_m"').replace("c = 2", "I_y = 9\nS = 3\nrho = 1\nc = 2")
    with pytest.raises(InputError, match=r"C_m is computed from q, which is constant in run\.csv"):
        regressed(tmp_path, moves=False, mapping=made.replace(', "q*c/2V"', ""))
