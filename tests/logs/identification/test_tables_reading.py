"""Tables as strangers write them, and their rows as even experiments in SI."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from logs.identification.sources.table.columns import Columns, Layout, read_columns
from logs.identification.sources.table.config import Map, load_map, rename_keys
from logs.identification.sources.table.maneuvers import DataSplit, data_split
from wingbeat.errors import InputError
from wingbeat.schema import read_record

WAVE = '[signals]\na = { column = "a", unit = "-" }\n'
TIMED = '[time]\ncolumn = "t"\n' + WAVE


def read(folder: Path, text: str | bytes, **layout: Any) -> Columns:
    path = folder / "run.csv"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return read_columns(path, Layout(**layout))


def cut_of(folder: Path, text: str, mapping: str) -> DataSplit:
    chosen: Map = read_record(Map, tomllib.loads(mapping), "")
    chosen.time.check()
    return data_split([read(folder, text)], chosen.signals, chosen.time, chosen.maneuvers)


def wave(time: np.ndarray, digits: int = 6) -> str:
    return "t,a\n" + "".join(f"{t:.{digits}f},{np.sin(t):.9f}\n" for t in time)


TABLES = {
    "plain": "t,a\n0,100\n0.5,-2.5\n",
    "semicolons and decimal commas": "t;a\n0;100\n0,5;-2,5\n",
    "tabs": "t\ta\n0\t100\n0.5\t-2.5\n",
    "blanks, no names, Fortran": "  0.0  1.0D+02\n  5.0d-1   -2.5\n",
    "blanks and decimal commas": "t a\n0,0 100\n0,5 -2,5\n",
    "comment's sign before the names, and units": "# t, a\n# s, deg\n0,100\n0.5,-2.5\n",
    "a preamble, Windows' line ends, a delimiter at the end": "Flight 12\r\nt,a\r\n0,100,\r\n0.5,-2.5,\r\n",
    "quoted": '"t","a"\n"0","100"\n"0.5","-2.5"\n',
    "another encoding": "t,a\n\u00b0,\u00b0/s\n0,100\n0.5,-2.5\n",
    "byte order mark": "\ufefft,a\n0,100\n0.5,-2.5\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_the_same_numbers_however_written(tmp_path: Path, name: str) -> None:
    text = TABLES[name]
    columns = read(tmp_path, text.encode("cp1252") if name == "another encoding" else text)
    assert columns.column(1, "key").tolist() == [0.0, 0.5]
    assert columns.column(2, "key").tolist() == [100.0, -2.5]
    if "no names" not in name:
        assert columns.column("a", "key").tolist() == [100.0, -2.5]


def test_what_stands_for_nothing_measured_is_nan(tmp_path: Path) -> None:
    text = "t,a\n0,-9999\n1,NaN\n2,\n3,NA\n4,inf\n5,7\n"
    values = read(tmp_path, text, missing=(-9999.0,)).column("a", "key")
    assert np.isnan(values[:5]).all() and values[5] == 7.0


def test_cells_that_are_no_numbers_and_short_rows_are_told(tmp_path: Path) -> None:
    notes = read(tmp_path, "t,a\n0,1\n1,oops\n2\n3,4\n4,5\n").findings
    assert [(one.code, one.value) for one in notes] == [("strange_cells", 1.0), ("short_rows", 1.0)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "empty"),
        ("only words\nand more\n", "no row of numbers"),
        (b"t,a\n\x81\xfe1,2\n", "no text in UTF-8"),
    ],
)
def test_what_is_no_table_is_refused(tmp_path: Path, text: str | bytes, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("column", "expected"),
    [("b", "no column 'b'; it has: t, a"), (3, "no column 3; it has 2"), ("x", "several columns 'x'")],
)
def test_a_column_that_is_not_there_is_told_with_those_that_are(
    tmp_path: Path, column: str | int, expected: str
) -> None:
    text = "x,x\n0,1\n1,2\n" if column == "x" else "t,a\n0,1\n1,2\n"
    with pytest.raises(InputError, match=expected):
        read(tmp_path, text).column(column, "signals.q.column")


@pytest.mark.parametrize(("rate", "digits"), [(0.1, 1), (25.0, 2), (600.0, 3), (600.0, 6)])
def test_stamps_rounded_in_the_file_give_the_even_base_that_was_sampled(
    tmp_path: Path, rate: float, digits: int
) -> None:
    time = np.arange(200) / rate
    (one,) = cut_of(tmp_path, wave(time, digits), TIMED).fitted
    assert one.step == pytest.approx(1 / rate, rel=1e-4)
    assert one.signals["a"] == pytest.approx(np.sin(time), abs=1e-8)


def test_uneven_time_is_interpolated_and_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    time = np.arange(500) * 0.02 + rng.uniform(-0.006, 0.006, 500)
    found = cut_of(tmp_path, wave(time), TIMED)
    (one,) = found.fitted
    assert np.nanmax(np.abs(one.signals["a"] - np.sin(one.time))) < 2e-4
    assert np.ptp(np.diff(one.time)) < 1e-12
    assert "uneven time" in " ".join(one.text for one in found.findings)


def test_rows_that_are_missing_are_not_measured_and_a_long_gap_cuts(tmp_path: Path) -> None:
    time = np.arange(1000) * 0.02
    kept = np.ones(1000, bool)
    kept[[100, 101, 300]] = False
    kept[600:700] = False
    found = cut_of(tmp_path, wave(time[kept]), TIMED)
    first, second = found.fitted
    assert np.flatnonzero(np.isnan(first.signals["a"])).tolist() == [100, 101, 300]
    assert (len(first.time), len(second.time)) == (600, 300)
    assert second.time[0] == pytest.approx(14.0)


def test_a_time_that_goes_back_begins_a_record_and_rows_tell_them_apart(tmp_path: Path) -> None:
    time = np.concatenate((np.arange(100), np.arange(80))) * 0.1
    assert [len(one.time) for one in cut_of(tmp_path, wave(time), TIMED).fitted] == [100, 80]
    expected = cut_of(tmp_path, wave(time), TIMED + "[maneuvers]\nrows = [[11, 60], [101, 180]]\nvalidate = [1]")
    assert [len(one.time) for one in expected.held_out] == [50]
    assert [len(one.time) for one in expected.fitted] == [80]
    with pytest.raises(InputError, match=r"maneuvers.windows\[0\]: the time of run.csv goes back"):
        cut_of(tmp_path, wave(time), TIMED + "[maneuvers]\nwindows = [[1, 5]]")


def test_manoeuvres_by_the_numbers_of_a_column(tmp_path: Path) -> None:
    text = "a,event\n" + "".join(f"{n},{1 if 20 <= n < 50 else 2 if 60 <= n < 95 else 0}\n" for n in range(100))
    mapping = "[time]\nrate = 10\n" + WAVE + '[maneuvers]\ncolumn = "event"\nvalidate = [2]'
    found = cut_of(tmp_path, text, mapping)
    assert found.fitted[0].signals["a"].tolist() == list(range(20, 50))
    assert found.held_out[0].signals["a"].tolist() == list(range(60, 95))


def test_scale_offset_and_units_make_si(tmp_path: Path) -> None:
    text = "nz;de;v\n" + "1,0;10;100\n" * 6
    signals = """[time]\nrate = 5\n[signals]
a_z = { column = "nz", unit = "g", scale = -1.0 }
delta = { column = 2, unit = "deg", offset = -4.0 }
V = { column = "v", unit = "kn" }
"""
    made = cut_of(tmp_path, text, signals).fitted[0].signals
    assert made["a_z"][0] == pytest.approx(-9.80665)
    assert made["delta"][0] == pytest.approx(np.radians(6.0))
    assert made["V"][0] == pytest.approx(51.4444, abs=1e-3)


def test_resampling_averages(tmp_path: Path) -> None:
    time = np.arange(6000) / 600
    (one,) = cut_of(tmp_path, wave(time), TIMED.replace('"t"', '"t"\nresample = 50')).fitted
    assert one.step == pytest.approx(0.02)
    assert one.signals["a"] == pytest.approx(np.sin(one.time), abs=1e-4)


def test_resampling_to_no_whole_share_of_the_rate_gives_the_rate_asked_for(tmp_path: Path) -> None:
    time = np.arange(3000) / 50
    (one,) = cut_of(tmp_path, wave(time), TIMED.replace('"t"', '"t"\nresample = 20')).fitted
    assert one.step == pytest.approx(0.05)
    there = np.isfinite(one.signals["a"])
    assert not there[:2].any() and there[6:-6].all()
    assert one.signals["a"][there] == pytest.approx(np.sin(one.time[there]), abs=2e-3)


@pytest.mark.parametrize(
    ("mapping", "expected"),
    [
        ('[time]\ncolumn = "t"\n', "signals is missing"),
        (WAVE, r"\[time\] must have either a column or a rate"),
        ("[time]\nrate = 0\n" + WAVE, "time.rate = 0 Hz is outside"),
        ("[time]\n" + WAVE, "either a column or a rate"),
        (TIMED.replace('"-"', '"furlong"'), "signals.a: unit 'furlong' is not known"),
        (TIMED.replace("a =", "q =").replace('"-"', '"deg"'), "signals.q is in rad/s; 'deg' cannot be that"),
        (TIMED.replace('column = "a"', 'colum = "a"'), r"unknown key signals.a.colum \(meant 'column'\?\)"),
        (TIMED + "[maneuvers]\nwindow = [[1, 2]]", r"unknown key maneuvers.window \(meant 'windows'\?\)"),
        (TIMED + "[maneuvers]\nwindows = [[5, 2]]", r"maneuvers.windows\[0\] ends at 2, before it begins at 5"),
        (TIMED + "[maneuvers]\nwindows = [[0, 5], [2, 8]]", r"windows\[0\] and maneuvers.windows\[1\] overlap"),
        (TIMED + "[maneuvers]\nwindows = [[500, 600]]", r"fewer than 5 samples of any record; there are 0 to 9.9 s"),
        (TIMED + "[maneuvers]\nvalidate = [1]", "none is left to fit"),
        (TIMED + "[maneuvers]\nvalidate = [7]", "there is no maneuver 7; there are 1"),
        (TIMED.replace("a =", "alpha =").replace('"-"', '"rad", scale = 100'), "signals.alpha reaches .* rad"),
        (TIMED + "[table]\ndecimal = 'x'", "table.decimal = 'x' is not known; known: ., ,"),
        (TIMED + '[modes]\noutputs = "q"', "modes.outputs must be a list"),
        (TIMED.replace(', unit = "-"', ""), "signals.a.unit is missing"),
        (TIMED + "[constants]\nmass = { value = 3 }", "constants.mass must be a number in SI or"),
    ],
)
def test_a_map_that_cannot_be_is_refused_by_its_key(tmp_path: Path, mapping: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected) as refused:
        cut_of(tmp_path, wave(np.arange(100) * 0.1), mapping)
    assert str(refused.value).isprintable()


MODES_MAP = """
[time]
column = "t"
[signals]
alpha = { column = "a", unit = "deg" }
q = { column = "q", unit = "deg/s" }
delta_e = { column = "%s", unit = "deg" }
[modes]
inputs = ["delta_e"]
outputs = ["alpha", "q"]
"""


def mapped(folder: Path, text: str) -> Map:
    path = folder / "map.toml"
    path.write_text(text, encoding="utf-8")
    return load_map(path)


@pytest.mark.parametrize("spelt", ["short_period", "short-period", "short period"])
def test_a_model_may_be_spelt_as_its_parts_are_joined_elsewhere(tmp_path: Path, spelt: str) -> None:
    found = mapped(tmp_path, MODES_MAP % "e" + f'model = "{spelt}"\nkinds = ["short period"]\n')
    assert found.modes is not None and found.modes.model == "short period" and found.modes.kinds == ("short_period",)


def test_former_keys_of_maps_are_accepted() -> None:
    """GIVEN every former key THEN the document has the present one; both at once are an error."""
    document = {
        "manoeuvres": {"validate_share": 0.3},
        "stand": {"vehicle": "slow_hawk"},
        "prepare": {"delay": {"alpha": {"like": "q"}, "q": 0.1}},
        "modes": {"hold": ["delta_e"], "band": [0.1, 2.0]},
        "aero": {"regressions": [{"always": ["alpha"], "band": [0.1, 2.0]}], "output_error": [{"hold": []}]},
    }
    rename_keys(document)
    assert document == {
        "maneuvers": {"validation_fraction": 0.3},
        "load_cell": {"vehicle": "slow_hawk"},
        "prepare": {"delay": {"alpha": {"reference": "q"}, "q": 0.1}},
        "modes": {"zoh_inputs": ["delta_e"], "frequency_band": [0.1, 2.0]},
        "aero": {
            "regressions": [{"forced_terms": ["alpha"], "frequency_band": [0.1, 2.0]}],
            "output_error": [{"zoh_inputs": []}],
        },
    }
    with pytest.raises(InputError, match="hold is the former name of zoh_inputs"):
        rename_keys({"modes": {"hold": [], "zoh_inputs": []}})
