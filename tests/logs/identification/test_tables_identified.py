"""`wingbeat identify TABLE --map MAP`: known truths within their intervals, however the table is written."""

from __future__ import annotations

import json
import runpy
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from groundstation.command import identify
from logs.identification.data.experiment import Experiment
from logs.identification.report.tables import notes_of, table_document
from logs.identification.results import EstimationResult
from logs.identification.sources.table.config import example_map, load_map
from logs.identification.sources.table.derived import DERIVED as MADE_OF
from logs.identification.sources.table.derived import Source
from logs.identification.sources.table.run import TableIdentification, identify_tables
from wingbeat.errors import InputError

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
MADE = runpy.run_path(str(EXAMPLES / "make_tables.py"))
TRUTH: Mapping[str, float] = MADE["SHORT_PERIOD"]
BASE = """
[time]
column = "t"
[signals]
alpha = { column = "alpha", unit = "rad" }
q = { column = "q", unit = "rad/s" }
a_z = { column = "a_z", unit = "m/s^2" }
delta_e = { column = "delta_e", unit = "rad" }
[constants]
V = 100
[modes]
inputs = ["delta_e"]
outputs = ["alpha", "q", "a_z"]
"""


def codes(result: EstimationResult | TableIdentification) -> set[str]:
    """Codes of the findings of a result, or of all of them."""
    if isinstance(result, EstimationResult):
        return {one.code for one in result.findings}
    return {one.code for one in result.findings}.union(*map(codes, result.fits))


def numbers(fit: EstimationResult) -> dict[str, Any]:
    assert fit.failure is None, fit.failure
    return {one.name: one for one in fit.estimates}


@cache
def motion(
    rate: float, duration: float, scale: float, actuator: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, states and input of a 3-2-1-1 of the short period, ``scale`` times slower, behind a lag of s, 0 none."""
    if actuator:  # what the lag does between samples is flown
        every = round(1000 / rate)
        t = 1e-3 * np.arange(round(duration * scale * rate) * every)
        command = np.radians(3) * MADE["multistep"](t, 1.0 * scale, 0.36 * scale)
        share = 1.0 - np.exp(-1e-3 / actuator)
        fine, states, delta = motion_of(t, lfilter([share], [1.0, share - 1.0], command), 1e-3, scale)
        return fine[::every], states[::every], delta[::every]
    t = np.arange(0, duration * scale, 1 / rate)
    return motion_of(t, np.radians(3) * MADE["multistep"](t, 1.0 * scale, 0.36 * scale), 1 / rate, scale)


def motion_of(
    t: np.ndarray, delta: np.ndarray, step: float, scale: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, states and input, a line between the times, of the short period."""
    p = slowed(scale)

    def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.array([
            p["Z_alpha"] * x[0] + x[1] + p["Z_delta"] * u[0],
            p["M_alpha"] * x[0] + p["M_q"] * x[1] + p["M_delta"] * u[0],
        ])  # fmt: skip

    parts = max(1, int(200 * step / scale))
    return t, MADE["fly"](rates, np.zeros(2), delta[:, None], step, parts), delta


def slowed(scale: float) -> dict[str, float]:
    return {name: value / scale ** (2 if name in ("M_alpha", "M_delta") else 1) for name, value in TRUTH.items()}


def flight(
    rate: float = 25.0, duration: float = 15.0, noise: float = 1.0, scale: float = 1.0, actuator: float = 0.0,
    seed: int = 5,
) -> dict[str, np.ndarray]:  # fmt: skip
    """Columns in SI as a noisy system records them."""
    t, states, delta = motion(rate, duration, scale, actuator)
    rng, p = np.random.default_rng(seed), slowed(scale)
    a_z = 100.0 * (p["Z_alpha"] * states[:, 0] + p["Z_delta"] * delta) - 9.80665
    sizes = (0.002, 0.003 / scale, 0.1 / scale)
    clean = {"alpha": states[:, 0] + 0.05, "q": states[:, 1], "a_z": a_z}
    noisy = {n: v + noise * rng.normal(0, s, len(t)) for (n, v), s in zip(clean.items(), sizes, strict=True)}
    return {"t": t, **noisy, "delta_e": delta - 0.02}


def write(path: Path, columns: Mapping[str, np.ndarray]) -> Path:
    rows = zip(*columns.values(), strict=True)
    path.write_text(",".join(columns) + "\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows))
    return path


def identified(
    folder: Path, columns: Mapping[str, np.ndarray], mapping: str = BASE, what: str = "modes"
) -> TableIdentification:
    (folder / "map.toml").write_text(mapping)
    return identify_tables([write(folder / "run.csv", columns)], folder / "map.toml", what)


def assert_truth(fit: EstimationResult, scale: float = 1.0) -> None:
    result = numbers(fit)
    for name, true in slowed(scale).items():
        one = result[name]
        assert abs(one.value - true) <= 1.5 * (one.high - one.value), (name, one)
        assert one.value == pytest.approx(true, rel=0.08), name


@pytest.mark.filterwarnings("error")
def test_the_documented_short_period_has_its_truth(capsys: pytest.CaptureFixture[str]) -> None:
    table, mapping = EXAMPLES / "short_period.csv", EXAMPLES / "short_period.toml"
    assert identify.run([str(table), "--map", str(mapping), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    fit, regression = document["fits"]
    assert fit["converged"] and not fit["unidentified"]
    for one in fit["estimates"]:
        assert one["low"] <= TRUTH[one["name"]] <= one["high"], one
    mass, area = 4400 * 0.45359237, 215 * 0.3048**2
    share = mass * 100.0 / (0.5 * 1.0 * 100.0**2 * area)
    result = {one["name"]: one for one in regression["estimates"]}
    assert result["alpha"]["low"] <= TRUTH["Z_alpha"] * share <= result["alpha"]["high"]
    assert result["delta_e"]["low"] <= TRUTH["Z_delta"] * share <= result["delta_e"]["high"]
    (mode,) = [one for one in document["modes"]["methods"] if one["method"] == "output error"]
    frequency = np.sqrt(TRUTH["Z_alpha"] * TRUTH["M_q"] - TRUTH["M_alpha"])
    assert mode["frequency"]["low"] <= frequency <= mode["frequency"]["high"]
    held = [one for one in fit["outputs"] if one["held_out"]]
    assert len(held) == 3 and all(one["theil"] < 0.1 for one in held)


@pytest.mark.filterwarnings("error")
def test_the_documented_transport_has_its_truth() -> None:
    result = identify_tables([EXAMPLES / "transport.csv"], EXAMPLES / "transport.toml", "aero")
    regression, fit = result.fits
    truth = MADE["TRANSPORT"]
    assert set(numbers(fit)) == set(truth)
    for name, one in numbers(fit).items():
        assert one.contains(truth[name]), one
    for name, key in (("alpha", "C_m_alpha"), ("q*c/2V", "C_m_q"), ("delta_e", "C_m_delta"), ("intercept", "C_m_0")):
        assert numbers(regression)[name].contains(truth[key])


def test_the_documented_tables_are_those_that_the_script_makes() -> None:
    assert (EXAMPLES / "short_period.csv").read_text() == MADE["short_period"]()
    assert (EXAMPLES / "transport.csv").read_text() == MADE["transport"]()


def test_what_the_page_shows_is_what_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    page = (EXAMPLES.parent / "identify_csv.md").read_text()
    identify.run([str(EXAMPLES / "transport.csv"), "--map", str(EXAMPLES / "transport.toml"), "aero"])
    shown = [line.split()[:2] for line in capsys.readouterr().out.splitlines() if line.startswith(("C_", "alpha "))]
    for words in shown:
        assert any(line.split()[:2] == words for line in page.splitlines()), words


def test_the_example_map_is_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    identify.run(["--map-example"])
    printed = capsys.readouterr().out
    assert printed == example_map("modes")
    (tmp_path / "map.toml").write_text(printed)
    assert load_map(tmp_path / "map.toml").modes is not None


def test_degrees_and_g_give_what_radians_and_metres_give(tmp_path: Path) -> None:
    columns = flight()
    plain = numbers(identified(tmp_path, columns).fits[0])
    other = {
        "t": columns["t"] * 1000, "alpha": np.degrees(columns["alpha"]), "q": np.degrees(columns["q"]),
        "a_z": -columns["a_z"] / 9.80665, "delta_e": np.degrees(columns["delta_e"]) + 3.0,
    }  # fmt: skip
    mapping = (
        BASE.replace('column = "t"', 'column = "t"\nunit = "ms"')
        .replace('"rad"', '"deg"').replace('"rad/s"', '"deg/s"').replace('"m/s^2"', '"g", scale = -1.0')
        .replace("V = 100", 'V = { value = 194.38444924406, unit = "kn" }')
    )  # fmt: skip
    for name, one in numbers(identified(tmp_path, other, mapping).fits[0]).items():
        assert one.value == pytest.approx(plain[name].value, rel=1e-3)
        assert one.high - one.low == pytest.approx(plain[name].high - plain[name].low, rel=1e-2)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("rate", "scale"),
    [
        pytest.param(0.1, 250.0, marks=pytest.mark.validate),
        (25.0, 1.0),
        pytest.param(600.0, 0.5, marks=pytest.mark.validate),
    ],
)
def test_from_a_tenth_of_a_hertz_to_six_hundred(tmp_path: Path, rate: float, scale: float) -> None:
    assert_truth(identified(tmp_path, flight(rate, scale=scale)).fits[0], scale)


@pytest.mark.filterwarnings("error")
def test_thirty_samples(tmp_path: Path) -> None:
    columns = {name: values[::5][:30] for name, values in flight(25.0, noise=0.2).items()}
    result = identified(tmp_path, columns)
    fit = result.fits[0]
    assert fit.failure is not None or all(np.isfinite(one.value) and one.high > one.low for one in fit.estimates)
    few = {name: values[:10] for name, values in columns.items()}
    with pytest.raises(InputError) as refused:
        identified(tmp_path, few)
    assert str(refused.value).isprintable()


@pytest.mark.filterwarnings("error")
def test_gaps_in_outputs_and_short_ones_in_the_input_do_no_harm(tmp_path: Path) -> None:
    columns = flight()
    columns["alpha"][100:160] = np.nan
    columns["q"][::7] = np.nan
    columns["delta_e"][[36, 37, 200]] = np.nan
    result = identified(tmp_path, columns)
    assert_truth(result.fits[0])
    said = " ".join(notes_of(result.fits[0]))
    assert "3 samples of delta_e interpolated" in said
    assert "60 of 375 samples of alpha not measured" in said and "54 of 375 samples of q not measured" in said


def test_a_long_gap_in_the_input_cuts_the_manoeuvre(tmp_path: Path) -> None:
    columns = flight()
    columns["delta_e"][150:200] = np.nan
    result = identified(tmp_path, columns)
    assert "50 samples without delta_e left out" in " ".join(notes_of(result.fits[0]))
    assert {one.experiment for one in result.fits[0].series} == {
        "maneuver 1 of run.csv, part 1", "maneuver 1 of run.csv, part 2",
    }  # fmt: skip


@pytest.mark.parametrize("column", ["q", 3])
def test_what_is_input_and_output_at_once_is_refused(tmp_path: Path, column: str | int) -> None:
    """GIVEN an input that is read from an output's column, in another unit and by its number too."""
    columns = flight()
    assert list(columns)[2] == "q"
    expected = f'column = {json.dumps(column)}, unit = "deg"'
    same = BASE.replace('column = "delta_e", unit = "rad"', expected)
    with pytest.raises(InputError, match="modes: input delta_e and output q are one signal"):
        identified(tmp_path, columns, same)
    both = BASE.replace('outputs = ["alpha"', 'outputs = ["delta_e", "alpha"')
    with pytest.raises(InputError, match="modes: delta_e is in inputs and in outputs"):
        identified(tmp_path, columns, both)
    other = same.replace("[modes]", '[[aero.output_error]]\nmodel = "short period"')
    with pytest.raises(InputError, match="input delta_e and output q are one signal"):
        identified(tmp_path, columns, other, "aero")


def test_an_input_a_little_early_is_named_where_output_error_finds_another_mode(tmp_path: Path) -> None:
    """GIVEN an elevator 0.2 s early: output error told 4.0 rad/s of 2.8 and no more than a vane far behind."""
    columns = flight(noise=0.2)
    columns["delta_e"] = np.interp(columns["t"] - 0.2, columns["t"], columns["delta_e"])
    result = identified(tmp_path, columns, BASE)
    assert result.modes is not None
    assert {"time_skew", "input_delay"} & codes(result)


@pytest.mark.validate
@pytest.mark.parametrize("late", [-0.47, 0.13])
def test_a_free_delay_is_found_from_where_the_equations_fit_best(tmp_path: Path, late: float) -> None:
    """GIVEN an aircraft four times as quick, whose elevator was recorded late or early THEN every method that gives a
    number has its mode."""
    columns = flight(100.0, scale=0.25)
    columns["delta_e"] = np.interp(columns["t"] + late, columns["t"], columns["delta_e"])
    result = identified(tmp_path, columns, BASE + 'delay = "free"\n')
    expected = {one.name: one for one in result.fits[0].estimates}
    assert expected["delay"].value == pytest.approx(late, abs=0.01)
    assert_truth(result.fits[0], 0.25)
    assert result.modes is not None
    for mode in result.modes.modes:
        assert mode.frequency is None or mode.frequency.value == pytest.approx(4 * 2.7928, rel=0.03), mode.method


def test_rolling_moments_need_no_inertia_of_pitch_where_no_pitch_rate_was_measured() -> None:
    time = 0.02 * np.arange(100)
    signals = {"p": 0.3 * np.sin(time), "r": 0.1 * np.cos(time), "qbar": np.full(100, 50.0)}
    one = Experiment("turn", time, signals, {"p": "rad/s", "r": "rad/s", "qbar": "Pa"})
    constants = {"I_x": 2.0, "I_z": 3.0, "S": 0.5, "b": 1.5}
    made = MADE_OF["C_l"][1](Source(one, constants, "C_l"))
    assert made[50] == pytest.approx(2.0 * 0.3 * np.cos(time[50]) / (50.0 * 0.5 * 1.5), rel=0.01)
    pitching = one._replace(signals={**signals, "q": 0.1 + 0.0 * time}, units={**one.units, "q": "rad/s"})
    with pytest.raises(InputError, match=r"constants\.I_[yz]"):
        MADE_OF["C_l"][1](Source(pitching, {"I_x": 2.0, "S": 0.5, "b": 1.5}, "C_l"))


@pytest.mark.validate
@pytest.mark.parametrize("late", [-0.32, 0.32])
def test_an_input_of_another_clock_is_named_and_its_delay_found(tmp_path: Path, late: float) -> None:
    """GIVEN an input that was recorded a third of a second off THEN output error begins at the delay result without
    it; without ``delay`` what it cannot follow is explained."""
    columns = flight(noise=0.2)
    columns["delta_e"] = np.interp(columns["t"] + late, columns["t"], columns["delta_e"])
    free = identified(tmp_path, columns, BASE + 'delay = "free"\n').fits[0]
    result = {one.name: one.value for one in free.estimates}
    assert result["delay"] == pytest.approx(late, abs=0.02)
    assert result["M_alpha"] == pytest.approx(TRUTH["M_alpha"], rel=0.05)
    held = identified(tmp_path, columns, BASE)
    assert held.modes is not None
    assert {"time_skew", "input_delay"} & codes(held)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("outputs", [["q", "a_z"], ["alpha", "q"], ["q", "a_z", "theta"], ["q_dot", "alpha"]])
def test_any_outputs(tmp_path: Path, outputs: list[str]) -> None:
    columns = flight(noise=0.3)
    step = columns["t"][1]
    columns["theta"] = np.cumsum(columns["q"]) * step + 0.1
    rng = np.random.default_rng(1)
    columns["q_dot"] = np.gradient(flight(noise=0.0)["q"], step) + rng.normal(0, 0.01, len(columns["t"]))
    mapping = BASE.replace('["alpha", "q", "a_z"]', json.dumps(outputs))
    mapping = mapping.replace(
        "[signals]",
        '[signals]\ntheta = { column = "theta", unit = "rad" }\nq_dot = { column = "q_dot", unit = "rad/s^2" }',
    )
    result = numbers(identified(tmp_path, columns, mapping).fits[0])
    assert result["M_alpha"].value == pytest.approx(TRUTH["M_alpha"], rel=0.1)
    assert result["M_delta"].value == pytest.approx(TRUTH["M_delta"], rel=0.1)


def test_a_channel_that_is_missing_is_told(tmp_path: Path) -> None:
    mapping = BASE.replace('a_z = { column = "a_z", unit = "m/s^2" }', "")
    with pytest.raises(InputError, match="modes: 'a_z' is not in \\[signals\\]; there are: alpha, q, delta_e"):
        identified(tmp_path, flight(), mapping)
    columns = flight()
    columns["q"][:] = np.nan
    with pytest.raises(InputError, match="output q has no sample"):
        identified(tmp_path, columns)
    columns["delta_e"][:] = np.nan
    with pytest.raises(InputError, match="modes: delta_e: nothing was measured"):
        identified(tmp_path, columns)


def test_a_fixed_parameter_is_held_and_a_delay_found(tmp_path: Path) -> None:
    columns = flight()
    columns["delta_e"] = np.interp(columns["t"] + 0.06, columns["t"], columns["delta_e"])
    free = "".join(f'{name} = "free"\n' for name in ("Z_alpha", "M_alpha", "M_q", "M_delta_e"))
    mapping = f'{BASE}delay = "free"\n[modes.parameters]\n{free}Z_delta = -0.15\n'
    fit = identified(tmp_path, columns, mapping).fits[0]
    result = numbers(fit)
    assert result["delay"].value == pytest.approx(0.06, abs=0.01)
    assert result["M_delta"].value == pytest.approx(-8.0, rel=0.03)
    assert fit.fixed == {"Z_delta": -0.15}


def test_an_input_that_does_not_move_is_refused_before_it_gives_damping_and_frequency(tmp_path: Path) -> None:
    """GIVEN an elevator that stands still THEN neither M_q nor a spectrum's peak is printed for a driven response."""
    columns = flight()
    columns["delta_e"][:] = 0.01
    with pytest.raises(InputError, match=r"modes: delta_e does not move; a free motion has inputs = \[\]"):
        identified(tmp_path, columns)


def test_a_regressor_that_depends_on_another_is_named(tmp_path: Path) -> None:
    columns = flight()
    columns["double"] = 2 * columns["alpha"]
    mapping = BASE.partition("[modes]")[0].replace(
        "[signals]", '[signals]\ndouble = { column = "double", unit = "rad" }'
    )
    mapping += '[[aero.regressions]]\nresponse = "a_z"\nregressors = ["alpha", "double", "delta_e"]\n'
    fit = identified(tmp_path, columns, mapping, "aero").fits[0]
    assert {one.subject for one in fit.withheld} >= {"alpha", "double"}
    assert "depends linearly on" in " ".join(notes_of(fit))
    assert "double" not in {one.name for one in fit.estimates}


def test_a_free_response_needs_no_input(tmp_path: Path) -> None:
    t = np.arange(0, 20, 0.05)
    rng = np.random.default_rng(2)
    swing = np.exp(-0.35 * t)
    columns = {"t": t, "q": 0.1 * swing * np.cos(3.0 * t) + rng.normal(0, 0.001, len(t))}
    mapping = """[time]
column = "t"
[signals]
q = { column = "q", unit = "rad/s" }
[modes]
model = "none"
outputs = ["q"]
"""
    result = identified(tmp_path, columns, mapping)
    assert result.modes is not None
    (mode,) = [one for one in result.modes.modes if one.method == "free response"]
    assert mode.frequency is not None and mode.damping is not None
    assert mode.frequency.value == pytest.approx(np.hypot(3.0, 0.35), rel=0.01)
    assert mode.damping.value == pytest.approx(0.35 / np.hypot(3.0, 0.35), rel=0.05)


def test_several_files_are_one_fit(tmp_path: Path) -> None:
    columns = flight()
    (tmp_path / "map.toml").write_text(BASE)
    files = [write(tmp_path / name, columns) for name in ("a.csv", "b.csv")]
    result = identify_tables(files, tmp_path / "map.toml", "modes")
    assert result.experiments == ("maneuver 1 of a.csv", "maneuver 2 of b.csv")
    json.dumps(table_document(result), allow_nan=False)


@pytest.mark.parametrize(
    ("regressor", "expected"),
    [
        ("alhpa", r"aero.regressions of a_z: 'alhpa' is neither in \[signals\] nor in \[constants\] \(meant 'alpha'"),
        ("q*cc/2V", "'cc' of 'q\\*cc/2V' is neither"),
        ("alpha**2", "regressor 'alpha\\*\\*2'"),
    ],
)
def test_a_regressor_that_is_misspelt_is_told_before_anything_is_fitted(
    tmp_path: Path, regressor: str, expected: str
) -> None:
    """GIVEN a map whose other sections can be had THEN the mistake is the answer, not a line below theirs."""
    mapping = BASE + f'[[aero.regressions]]\nresponse = "a_z"\nregressors = ["{regressor}", "delta_e"]\n'
    with pytest.raises(InputError, match=expected):
        identified(tmp_path, flight(), mapping, "all")
    assert identified(tmp_path, flight(), mapping, "modes").fits, "what does not need it is had for itself"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["run.csv"], "tables need --map"),
        ([], "which log or table"),
        (["run.csv", "--map", "none.toml"], "cannot read map none.toml"),
        (["run.csv", "servo", "--map", "map.toml"], "no section \\[servo\\] that says what to fit"),
        (["run.csv", "aero", "--map", "map.toml"], r"it has no section \[aero\]"),
        (["none.csv", "--map", "map.toml"], "cannot read none.csv"),
        (["run.csv", "--map", "map.toml", "--vehicle", "x"], "--vehicle is for logs"),
    ],
)
def test_a_command_line_that_cannot_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], expected: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "map.toml").write_text(BASE)
    write(tmp_path / "run.csv", flight())
    with pytest.raises(InputError, match=expected):
        identify.run(words)


def test_a_nonlinear_model_needs_its_thrust_told_and_takes_a_constant(tmp_path: Path) -> None:
    table, whole = EXAMPLES / "transport.csv", (EXAMPLES / "transport.toml").read_text()
    signal = 'thrust = { column = 10, unit = "N" }\n'
    assert signal in whole
    untold = whole.replace(signal, "")[: whole.replace(signal, "").index("[[aero.regressions]]")]
    (tmp_path / "map.toml").write_text(untold)
    with pytest.raises(InputError, match=r"needs signals\.thrust or constants\.thrust \(0 for a glide\) \(map"):
        identify_tables([table], tmp_path / "map.toml", "aero")
    (tmp_path / "map.toml").write_text(untold.replace("[constants]", "[constants]\nthrust = 9850"))
    result = numbers(identify_tables([table], tmp_path / "map.toml", "aero").fits[0])
    assert result["C_m_alpha"].contains(MADE["TRANSPORT"]["C_m_alpha"])
