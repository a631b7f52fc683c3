"""Findings and errors of maps: kinds of modes, steady readings, constant readings, axes, methods without a model."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from four_state_flapper import record

from groundstation.command.main import main
from logs.identification.diagnostics import Context
from logs.identification.diagnostics.model_structure import lack_of_fit
from logs.identification.findings import CATALOG
from logs.identification.models.modes import split_pairs
from logs.identification.report.tables import correlation_lines, notes_of
from logs.identification.results import EstimationResult, FitSeries, estimate
from logs.identification.sources.table.run import TableIdentification, identify_tables
from logs.identification.statistics.fit_quality import Pair
from tests.logs.identification.test_tables_four_states import MAP
from tests.logs.identification.test_tables_identified import BASE, codes, flight, identified, write
from wingbeat.errors import InputError

BENCH = """
[time]
rate = 1.0
[signals]
torque = { column = "torque", unit = "N m" }
current = { column = "current", unit = "A" }
"""


def test_oscillation_faster_than_a_phugoid_is_the_short_period() -> None:
    """GIVEN two fast real eigenvalues and a pair at 6 rad/s THEN the airspeed decides which is the short period."""
    system = np.zeros((4, 4))
    system[:2, :2], system[2:, 2:] = [[0.0, 1.0], [-36.0, -1.2]], np.diag([-9.0, -7.0])
    assert np.allclose(np.abs(split_pairs(system, 4.0)[0]), 6.0)
    assert np.allclose(np.sort(split_pairs(system, 8.0)[0].real), [-9.0, -7.0])


def test_a_mode_too_fast_for_its_kind_has_a_finding(tmp_path: Path) -> None:
    """GIVEN a motion at 2.8 rad/s and 100 m/s, called a phugoid THEN Lanchester's frequency contradicts it."""
    found = identified(tmp_path, flight(), BASE + 'model = "none"\nkinds = ["phugoid"]\n')
    assert found.modes is not None
    named = [one for one in found.modes.findings if one.code == "mode_kind"]
    assert named and all(one.severity == "warning" and one.value > 2.0 > one.limit for one in named)
    plain = identified(tmp_path, flight(), BASE)
    assert plain.modes is not None and not [one for one in plain.modes.findings if one.code == "mode_kind"]


def test_a_method_without_a_model_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='method = "filter_error" needs a model'):
        identified(tmp_path, flight(), BASE + 'model = "none"\nmethod = "filter_error"\n')


@pytest.mark.validate
def test_automatic_four_states_do_not_depend_on_the_vane_bias(tmp_path: Path) -> None:
    """GIVEN a vane that reads 0.15 rad more and no pitch angle THEN stability axes give the same derivatives."""
    columns = record(1, 30.0)
    first, second = (
        identified(tmp_path, columns | {"alpha": columns["alpha"] + bias}, MAP).fits[0] for bias in (0.0, 0.15)
    )
    assert {"model_selection", "stability_axes"} <= codes(first)
    for one in first.estimates:
        other = second.estimate(one.name)
        assert other is not None and other.value == pytest.approx(one.value, abs=0.1 * one.standard_error)


@pytest.mark.parametrize(
    ("constants", "expected"),
    [("", True), pytest.param("alpha = 0.0\ntheta = 0.0\n", False, marks=pytest.mark.validate)],
)
def test_a_trim_angle_from_a_vane_has_a_finding(tmp_path: Path, constants: str, expected: bool) -> None:
    mapping = MAP.replace("V = 8.0\n", f"V = 8.0\n{constants}") + 'states = 4\nmethod = "output_error"\n'
    found = identified(tmp_path, record(1, 30.0), mapping)
    assert ("trim_from_vane" in codes(found.fits[0])) is expected


def bench(folder: Path, current: np.ndarray, torque: np.ndarray, section: str) -> TableIdentification:
    (folder / "map.toml").write_text(BENCH + section)
    return identify_tables(
        [write(folder / "bench.csv", {"current": current, "torque": torque})], folder / "map.toml", "all"
    )


def test_uncorrelated_rows_without_time_are_steady_readings(tmp_path: Path) -> None:
    """GIVEN readings in random order, and in the order of a sweep THEN only the first are independent."""
    rng = np.random.default_rng(1)
    current = rng.uniform(0.5, 3.5, 80)
    for order, expected in ((np.arange(80), True), (np.argsort(current), False)):
        torque = 0.78 * current[order] - 0.29 + 0.01 * np.convolve(rng.normal(size=84), np.ones(5) / 5, "valid")
        found = bench(tmp_path, current[order], torque, "[servo]\n")
        assert ("steady_readings" in codes(found)) is expected
        assert found.records[0].steady is expected


def test_a_torque_of_zero_gives_no_model_of_the_servo(tmp_path: Path) -> None:
    current = np.linspace(0.5, 3.0, 40)
    (fit,) = bench(tmp_path, current, np.zeros(40), "[servo]\n").fits
    assert not fit.estimates and fit.status == "not identifiable"
    assert fit.failure is not None and fit.failure.code == "constant_reading"
    assert {one.subject for one in fit.withheld} == {"K_tau", "K_tau0"}


def test_at_most_five_correlations_are_listed_largest_first() -> None:
    pairs = [Pair(f"a{n}", f"b{n}", (-1.0) ** n * (0.9 + n / 1000)) for n in range(24)]
    lines = correlation_lines(pairs)
    assert len(lines) == 6 and lines[0].startswith("a23 and b23") and lines[-1].startswith("19 more")
    assert len(correlation_lines(pairs[:5])) == 5


@pytest.mark.parametrize(
    ("model", "method", "remedies"),
    [
        ("short period", "output_error", {"states = 4", "filter_error"}),
        ("longitudinal", "output_error", {"filter_error"}),
        ("longitudinal", "filter_error", set()),
    ],
)
def test_the_remedy_of_a_lack_of_fit_is_not_what_is_used(model: str, method: str, remedies: set[str]) -> None:
    time = np.linspace(0.0, 10.0, 500)
    rng = np.random.default_rng(1)
    measured = np.sin(3 * time) + 0.001 * rng.normal(size=500)
    series = (FitSeries("maneuver 1", "q", "rad/s", time, measured, 0.5 * np.sin(3 * time)),)
    (one,) = lack_of_fit(Context((), result=EstimationResult(method, model=model, series=series), linear=True))
    text = one.line
    assert {word for word in ("states = 4", "filter_error") if word in text} == remedies


def test_a_map_with_former_keys_gives_the_same_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN [manoeuvres] and hold THEN the command prints what it prints for [maneuvers] and zoh_inputs."""
    table, printed = write(tmp_path / "run.csv", flight()), []
    for section, key in (("manoeuvres", "hold"), ("maneuvers", "zoh_inputs")):
        mapping = BASE + f'{key} = ["delta_e"]\n[{section}]\nwindows = [[0, 15]]\n'
        (tmp_path / "map.toml").write_text(mapping)
        assert main(["identify", str(table), "--map", str(tmp_path / "map.toml"), "modes", "--json"]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1]


MODULES = ("logs.identification.sources", "logs.identification.diagnostics")
MOST_WORDS = 12


def test_findings_have_at_most_twelve_words() -> None:
    """GIVEN the codes of sources and diagnostics THEN text and remedy are short; a placeholder is one word."""
    codes_here = {
        code
        for name in MODULES
        for file in Path(import_module(name).__path__[0]).rglob("*.py")
        for code in re.findall(r'^    "(\w+)": Entry\(', file.read_text(), re.MULTILINE)
    }
    assert len(codes_here) > 40
    for code in codes_here:
        for text in (CATALOG[code].text, CATALOG[code].remedy):
            assert len(re.sub(r"\{[^}]*\}", "x", text).split()) <= MOST_WORDS, code


@pytest.mark.parametrize("name", ["short_period", "transport"])
def test_cells_of_printed_tables_have_at_most_twelve_words(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN the documented examples THEN no cell (two spaces or a line end part them) is a sentence."""
    example = Path(__file__).parents[3] / "docs" / "examples" / name
    assert main(["identify", f"{example}.csv", "--map", f"{example}.toml"]) == 0
    rows = [re.split(r"\s{2,}", line.strip()) for line in capsys.readouterr().out.splitlines()]
    cells = [cell for row in rows if len(row) > 2 for cell in row]
    assert len(cells) > 60 and max(len(cell.split()) for cell in cells) <= MOST_WORDS


def test_notes_of_a_result_do_not_list_all_correlations() -> None:
    names = [f"p{n}" for n in range(8)]
    covariance = np.full((8, 8), 0.99) + 0.01 * np.eye(8)
    result = EstimationResult(
        "output_error", estimates=tuple(estimate(name, "-", 1.0, 1.0) for name in names), covariance=covariance
    )
    assert sum("correlated by" in line for line in notes_of(result)) == 5
