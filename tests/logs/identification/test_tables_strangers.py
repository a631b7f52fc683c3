"""Records as other people's loggers write them: clocks, coarse stamps, drop-outs, units, vanes on booms."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.modal import records_of
from logs.identification.estimators.nonparametric import modes_of_experiments
from logs.identification.estimators.spectrum import spectrum
from logs.identification.models.modes import PHUGOID
from logs.identification.sources.table.columns import seconds_of
from logs.identification.sources.table.run import TableIdentification, identify_tables
from tests.logs.identification.test_tables_identified import BASE, assert_truth, codes, flight, numbers
from tests.logs.identification.test_tables_reading import read
from wingbeat.errors import InputError

TWO_STATES = BASE + 'states = 2\nmethod = "output_error"\n'
"""one fit: no selection of the model"""
THETA = BASE.replace("[constants]", 'theta = { column = "theta", unit = "rad" }\n[constants]\ntheta = 0.07')


def identified(folder: Path, columns: Mapping[str, Any], mapping: str = BASE) -> TableIdentification:
    """As from a file whose cells are written as Python writes them."""
    rows = zip(*columns.values(), strict=True)
    text = ",".join(columns) + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)
    (folder / "run.csv").write_text(text)
    (folder / "map.toml").write_text(mapping)
    return identify_tables([folder / "run.csv"], folder / "map.toml", "modes")


def texts_of(result: TableIdentification) -> str:
    return "; ".join(one.text for one in (*result.findings, *(one for fit in result.fits for one in fit.findings)))


def test_time_since_1970_gives_what_time_from_zero_gives(tmp_path: Path) -> None:
    columns = flight()
    plain, late = (identified(tmp_path, columns | {"t": columns["t"] + start}) for start in (0.0, 1.7e9))
    for name, one in numbers(plain.fits[0]).items():
        assert numbers(late.fits[0])[name].value == pytest.approx(one.value, rel=1e-3)
    assert plain.modes is not None
    assert late.modes is not None
    assert [one.frequency is None for one in plain.modes.modes] == [one.frequency is None for one in late.modes.modes]


@pytest.mark.parametrize("coarse", [pytest.param(0.1, marks=pytest.mark.validate), 1.0])
def test_stamps_that_rows_share_lie_evenly_between(tmp_path: Path, coarse: float) -> None:
    columns = flight(50.0)
    found = identified(tmp_path, columns | {"t": np.floor(columns["t"] / coarse + 1e-9) * coarse})
    assert {"coarse_time"} <= codes(found)
    assert_truth(found.fits[0])


def test_coarse_stamps_of_rows_that_are_not_even_are_refused(tmp_path: Path) -> None:
    columns = flight(50.0)
    kept = np.concatenate((np.arange(0, 300), np.arange(300, len(columns["t"]), 5)))
    coarse = {name: values[kept] for name, values in columns.items()} | {"t": np.floor(columns["t"][kept])}
    with pytest.raises(InputError, match="the time is too coarse; give"):
        identified(tmp_path, coarse)


@pytest.mark.validate
def test_jittered_stamps_of_which_some_are_shared_are_used(tmp_path: Path) -> None:
    """GIVEN rows that jitter by a third of their step under stamps as coarse THEN what shares a stamp is left out."""
    columns = flight(100.0)
    jitter = np.random.default_rng(2).uniform(-0.006, 0.006, len(columns["t"]))
    late = columns["t"] + np.where(columns["t"] > columns["t"].mean(), 0.4, 0.0)  # and a second half that came later
    found = identified(tmp_path, columns | {"t": np.sort(np.round((late + jitter) / 0.01) * 0.01)}, TWO_STATES)
    assert "with the time of the row before left out" in texts_of(found)
    assert found.fits[0].estimates


def test_rows_of_one_time_that_tell_different_signals_are_one_row(tmp_path: Path) -> None:
    columns = flight()
    twice = {name: np.repeat(values, 2) for name, values in columns.items()}
    twice["alpha"][::2] = np.nan
    twice["q"][1::2] = np.nan
    found = identified(tmp_path, twice)
    assert f"{len(columns['t'])} rows joined with the row of the same time" in texts_of(found)
    assert numbers(found.fits[0]) == numbers(identified(tmp_path, columns).fits[0])


@pytest.mark.parametrize(
    ("cell", "decimal", "seconds"),
    [
        ("16:04:05.25", ".", 57845.25),
        ("16:04:05,25", ",", 57845.25),
        ("04:05.25", ".", 245.25),
        ("123:16:04:05.25", ".", 123 * 86400 + 57845.25),
        ("1970-01-02T00:00:01.5", ".", 86401.5),
        ("1970-01-02 02:00:01.5+02:00", ".", 86401.5),
        ("noon", ".", np.nan),
        ("12.5", ".", np.nan),
        ("99:12.5", ".", 99 * 60 + 12.5),
        ("99:99", ".", np.nan),
        ("16:75:05", ".", np.nan),
        ("123:24:04:05", ".", np.nan),
    ],
)
def test_clocks_and_dates_in_seconds(cell: str, decimal: str, seconds: float) -> None:
    assert seconds_of(cell, decimal) == pytest.approx(seconds, nan_ok=True)


def test_a_column_of_clocks_is_a_time(tmp_path: Path) -> None:
    columns = flight()
    clocks = [f"16:04:{float(t):09.6f}" for t in columns["t"]]
    found, plain = (identified(tmp_path, columns | {"t": t}) for t in (clocks, columns["t"]))
    for name, one in numbers(plain.fits[0]).items():
        assert numbers(found.fits[0])[name].value == pytest.approx(one.value, rel=1e-6)
    with pytest.raises(InputError, match="'noon' is neither a number nor a clock"):
        identified(tmp_path, columns | {"t": ["noon"] * len(clocks)})
    with pytest.raises(InputError, match=r"column 'alpha' of run\.csv holds clocks or dates, no numbers"):
        identified(tmp_path, columns | {"alpha": clocks})
    with pytest.raises(InputError, match=r"clocks in 't': their unit is s"):
        identified(tmp_path, columns | {"t": clocks}, BASE.replace('column = "t"', 'column = "t"\nunit = "ms"', 1))


def test_time_that_runs_backwards_is_told(tmp_path: Path) -> None:
    columns = flight()
    with pytest.raises(InputError, match="its time goes back in 374 of 375 rows"):
        identified(tmp_path, {name: values[::-1] for name, values in columns.items()})


@pytest.mark.parametrize(
    "text",
    [
        "t,a,b\n0,1,\n1,2,\n2,3,5\n3,4,6\n",
        "t,a,b\ns,deg,\n0,1,\n1,2,\n2,3,5\n3,4,6\n",
        "Flight 12,,\nt,a,b\n0,1,\n1,2,\n2,3,5\n3,4,6\n",
        "Flight 12,pilot Smith\nt,a,b\n0,1,\n1,2,\n2,3,5\n3,4,6\n",
    ],
)
def test_a_last_cell_that_is_blank_in_the_first_rows_takes_no_names(tmp_path: Path, text: str) -> None:
    columns = read(tmp_path, text)
    assert columns.column("a", "key").tolist() == [1.0, 2.0, 3.0, 4.0]
    assert np.isnan(columns.column("b", "key")).tolist() == [True, True, False, False]


def test_a_number_that_stands_for_nothing_is_taken_for_it_where_it_is_far_from_all_else(tmp_path: Path) -> None:
    columns = flight()
    columns["a_z"] = columns["a_z"].copy()
    columns["a_z"][100:110] = np.nan
    missing = identified(tmp_path, columns)
    columns["a_z"][100:110] = -9999
    found = identified(tmp_path, columns)
    assert "-9999 in a_z taken as not measured" in texts_of(found)
    assert numbers(found.fits[0]) == numbers(missing.fits[0])


def test_spikes_are_told(tmp_path: Path) -> None:
    columns = flight()
    columns["q"] = columns["q"].copy()
    assert "outliers" not in codes(identified(tmp_path, columns, TWO_STATES))
    columns["q"][100:103] = 1.0
    assert "3 outliers of q from 4 s on" in texts_of(identified(tmp_path, columns, TWO_STATES))


def test_units_of_inputs_that_their_size_contradicts(tmp_path: Path) -> None:
    columns = flight()
    degrees = columns | {"delta_e": np.degrees(columns["delta_e"])}
    assert "its range is 344 deg; is it in deg, not in rad?" in texts_of(identified(tmp_path, degrees))
    called = BASE.replace('"delta_e", unit = "rad"', '"delta_e", unit = "deg"')
    assert_truth(identified(tmp_path, degrees, called).fits[0])
    small = columns | {"delta_e": np.radians(columns["delta_e"])}
    assert "times as far; is it in rad, not in deg?" in texts_of(identified(tmp_path, small))
    assert "unit" not in codes(identified(tmp_path, columns))


def test_pitch_alone_does_not_tell_what_only_gravity_would(tmp_path: Path) -> None:
    columns = flight(50.0)
    columns["theta"] = np.cumsum(columns["q"]) / 50.0 + np.random.default_rng(3).normal(0, 0.001, len(columns["t"]))
    found = identified(tmp_path, columns, THETA.replace('["alpha", "q", "a_z"]', '["q", "theta"]')).fits[0]
    told = {one.name for one in found.estimates}
    assert not told & {"Z_alpha", "Z_delta", "M_q"}, found.estimates
    assert {one.subject for one in found.withheld} >= {"Z_alpha", "Z_delta", "M_q"}


def test_a_vane_on_a_boom_tells_the_derivatives_of_the_centre_of_mass(tmp_path: Path) -> None:
    columns = flight()
    ahead = columns | {"alpha": columns["alpha"] - columns["q"] * 6.0 / 100.0}
    told = BASE.replace("V = 100", "V = 100\nvane_x = 6")
    assert_truth(identified(tmp_path, ahead, told).fits[0])
    wrong = numbers(identified(tmp_path, ahead).fits[0])["M_alpha"]
    assert not wrong.contains(-6.0)
    lacking = told.replace('q = { column = "q", unit = "rad/s" }\n', "").replace('"alpha", "q"', '"alpha"')
    with pytest.raises(InputError, match=r"constants.vane_x needs signals.q"):
        identified(tmp_path, columns, lacking)


def test_a_sideslip_that_nothing_uses_needs_no_yaw_rate_for_a_vane_ahead(tmp_path: Path) -> None:
    """GIVEN both vanes on a boom and no yaw rate THEN the short period is fitted, and what uses beta is refused."""
    columns = flight()
    ahead = columns | {"alpha": columns["alpha"] - columns["q"] * 6.0 / 100.0, "beta": columns["q"]}
    told = BASE.replace("V = 100", "V = 100\nvane_x = 6")
    told = told.replace("[constants]", 'beta = { column = "beta", unit = "rad" }\n[constants]')
    assert_truth(identified(tmp_path, ahead, told).fits[0])
    with pytest.raises(InputError, match=r"constants.vane_x needs signals.r"):
        identified(tmp_path, ahead, told.replace('inputs = ["delta_e"]', 'inputs = ["delta_e", "beta"]'))


def ringing(rate: float, duration: float) -> Experiment:
    """A ring-down of 6.3 rad/s and 0.055 in white noise."""
    frequency, damping, time = 6.3, 0.055, np.arange(0.0, duration, 1.0 / rate)
    q = np.exp(-damping * frequency * time) * np.cos(frequency * np.sqrt(1 - damping**2) * time)
    noise = 0.03 * np.random.default_rng(1).normal(size=len(time))
    return Experiment("one", time, {"q": q + noise}, {"q": "rad/s"})


def test_a_spectrum_of_a_ring_down_that_is_cut_off_is_refused() -> None:
    cut_off, whole = (spectrum(records_of((ringing(200.0, span),), None, ("q",))) for span in (4.0, 12.0))
    assert cut_off.frequency is None
    assert "leak" in cut_off.withheld[0].text
    assert whole.damping is not None
    assert whole.damping.contains(0.055)


def test_a_record_with_the_speed_in_it_holds_a_phugoid_as_well() -> None:
    time = np.arange(0.0, 300.0, 0.5)
    slow = np.exp(-0.003 * time) * np.cos(0.067 * time)
    noise = np.random.default_rng(2).normal(size=(2, len(time)))
    signals = {"u": 5.0 * slow + 0.1 * noise[0], "q": 0.001 * np.gradient(slow, time) + 1e-6 * noise[1]}
    one = Experiment("one", time, signals, {"u": "m/s", "q": "rad/s"})
    for mode in modes_of_experiments((one,), None, ("u", "q")).modes:
        assert mode.phugoid is not None or PHUGOID in {lost.subject for lost in mode.withheld}, mode.method


@pytest.mark.validate
def test_an_input_of_two_levels_is_no_gap(tmp_path: Path) -> None:
    """GIVEN counts of which the upper is what other loggers write for nothing THEN the input is what it says."""
    columns = flight()
    level = np.where(columns["delta_e"] > 0, 999.0, 0.0)
    told = BASE.replace('"delta_e", unit = "rad"', '"delta_e", unit = "rad", scale = 1e-4')
    found = identified(tmp_path, columns | {"delta_e": level}, told)
    assert "taken as not measured" not in texts_of(found)


def gusty(seed: int) -> dict[str, Any]:
    """Columns of an aircraft that gusts alone move, as they change over a second."""
    rng, step = np.random.default_rng(seed), 0.02
    columns = np.zeros((6000, 3))
    alpha, q, gust = 0.0, 0.0, 0.0
    for k in range(len(columns)):
        gust += step * -gust + 0.02 * np.sqrt(2.0 * step) * rng.normal()
        felt = alpha + gust
        columns[k] = felt, q, -0.8 * 190.0 * felt - 9.81
        alpha, q = alpha + step * (q - 0.8 * felt), q + step * (-12.0 * felt - 1.0 * q)
    noisy = columns + rng.normal(size=columns.shape) * [0.002, 0.003, 0.1]
    return {"t": step * np.arange(len(columns))} | dict(zip(("alpha", "q", "a_z"), noisy.T, strict=True))


@pytest.mark.validate
def test_gusts_alone_are_process_noise(tmp_path: Path) -> None:
    """GIVEN an aircraft that gusts alone move WHEN the map leaves the method open THEN it is filter error."""
    mapping = BASE.replace('inputs = ["delta_e"]', "inputs = []").replace("V = 100", "V = 190")
    without_input = "\n".join(line for line in mapping.splitlines() if not line.startswith("delta_e"))
    (fit,) = identified(tmp_path, gusty(1), without_input).fits
    assert fit.method == "filter_error"
    assert numbers(fit)["M_alpha"].value == pytest.approx(-12.0, rel=0.15)
