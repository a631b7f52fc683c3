"""Methods of [modes] and [aero] of a map: equation error in the frequency domain, orthogonal functions."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete
from test_tables_identified import BASE, TRUTH, codes, flight, identified, write

from groundstation.command import identify
from logs.identification.diagnostics.estimates import jumps
from wingbeat.errors import InputError


def methods(folder: Path, mapping: str, capsys: pytest.CaptureFixture[str], **simulated: float) -> dict[str, Any]:
    """The modes of a flight by every method, as the command tells them."""
    (folder / "map.toml").write_text(mapping)
    table = write(folder / "run.csv", flight(**simulated))
    assert identify.run([str(table), "modes", "--map", str(folder / "map.toml"), "--json"]) == 0
    return {one["method"]: one for one in json.loads(capsys.readouterr().out)["modes"]["methods"]}


@pytest.mark.parametrize(
    "force", [pytest.param(True, marks=pytest.mark.validate), pytest.param(False, marks=pytest.mark.validate)]
)
def test_equation_error_in_the_frequency_domain_has_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], force: bool
) -> None:
    """GIVEN eight noisy records, with a_z or without THEN 85 % of all intervals have the truth, each within 3 %."""
    mapping = BASE + 'model = "none"\n'
    if not force:
        mapping = mapping.replace('a_z = { column = "a_z", unit = "m/s^2" }\n', "").replace(', "a_z"]', "]")
    frequency = np.sqrt(TRUTH["Z_alpha"] * TRUTH["M_q"] - TRUTH["M_alpha"])
    damping = -(TRUTH["Z_alpha"] + TRUTH["M_q"]) / (2 * frequency)
    inside = []
    for seed in range(8):
        (tmp_path / str(seed)).mkdir()
        found = methods(tmp_path / str(seed), mapping, capsys, seed=seed)["equation error"]
        for name, true in (("frequency", frequency), ("damping", damping)):
            inside.append(found[name]["low"] <= true <= found[name]["high"])
            assert found[name]["value"] == pytest.approx(true, rel=0.03)
        assert [one["name"] for one in found["derivatives"]] == ["Z_alpha", "Z_delta", "M_alpha", "M_q", "M_delta"]
        inside += [one["low"] <= TRUTH[one["name"]] <= one["high"] for one in found["derivatives"]]
    assert np.mean(inside) >= 0.85


def test_equation_error_says_what_it_lacks_and_keeps_to_its_band(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = BASE.replace('alpha = { column = "alpha", unit = "rad" }\n', "").replace('"alpha", "q"', '"q"')
    (refused,) = methods(tmp_path, without, capsys)["equation error"]["unidentified"]
    assert refused["reason"] == "it takes alpha measured"
    narrow = methods(tmp_path, BASE + "band = [0.05, 1.0]\n", capsys)["equation error"]
    assert narrow["frequency"]["value"] == pytest.approx(2.793, rel=0.03)
    with pytest.raises(InputError, match=r"modes: frequency_band = \[2, 1\] Hz contains no frequency"):
        methods(tmp_path, BASE + "band = [2.0, 1.0]\n", capsys)


def test_held_derivatives_stay_where_the_map_holds_them_in_equation_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    held = "[modes.parameters]\nZ_alpha = 'free'\nZ_delta_e = -0.15\nM_alpha = 'free'\nM_q = -1.5\nM_delta = 'free'\n"
    found = methods(tmp_path, BASE + held, capsys)["equation error"]
    assert [one["name"] for one in found["derivatives"]] == ["Z_alpha", "M_alpha", "M_delta"]
    assert found["frequency"]["value"] == pytest.approx(2.793, rel=0.02)


@pytest.mark.parametrize(("rate", "expected"), [(10.0, True), pytest.param(50.0, False, marks=pytest.mark.validate)])
def test_ramps_of_few_samples_are_named(tmp_path: Path, rate: float, expected: bool) -> None:
    """GIVEN an input that goes over in 0.2 s THEN at 10 Hz its course is not known, at 50 Hz it is."""
    columns = flight(rate=rate)
    edges = np.array([1.03, 2.11, 2.83, 3.19, 3.55])
    levels = np.radians([0.0, 3.0, -3.0, 3.0, -3.0, 0.0])
    ramps = [b * np.clip((columns["t"] - e) / 0.2, 0, 1) for e, b in zip(edges, np.diff(levels), strict=True)]
    columns["delta_e"] = np.sum(ramps, axis=0)
    assert ("sampling" in codes(identified(tmp_path, columns, BASE).fits[0])) is expected


@pytest.mark.parametrize(("rate", "expected"), [pytest.param(2.5, False, marks=pytest.mark.validate), (10.0, True)])
def test_a_mode_that_turns_far_between_samples_of_an_unseen_input_is_not_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rate: float, expected: bool
) -> None:
    """GIVEN an actuator's course that 2.5 samples a second do not show, and 5.6 of them in a period."""
    found = methods(tmp_path, BASE, capsys, rate=rate, duration=40.0, actuator=0.15)
    driven = [found[name] for name in ("output error", "equation error", "equivalent system")]
    assert [one["frequency"] is not None for one in driven] == [expected] * 3
    if not expected:
        assert sum("samples in a period" in one["unidentified"][0]["reason"] for one in driven) >= 2


ORTHOGONAL = """
[time]
column = "t"
[signals]
alpha = { column = "alpha", unit = "deg" }
delta_e = { column = "delta_e", unit = "deg" }
C_m = { column = "C_m", unit = "-" }
[maneuvers]
windows = [[0, 20], [20.02, 30]]
validate = [2]
[[aero.regressions]]
response = "C_m"
method = "orthogonal"
regressors = ["alpha", "alpha^2", "alpha^3", "delta_e", "alpha*delta_e", "alpha^2*delta_e", "delta_e^2"]
"""


def moments(folder: Path, mapping: str = ORTHOGONAL) -> list[str]:
    """C_m = 0.05 - 0.9 alpha + 2.5 alpha^3 - 1.2 delta_e with noise, at angles up to 0.5 rad."""
    rng, t = np.random.default_rng(9), np.arange(0, 30, 0.02)
    alpha = 0.25 * np.sin(0.9 * t) + 0.2 * np.sin(2.3 * t + 1) + 0.05
    delta = 0.15 * np.sign(np.sin(1.7 * t)) + 0.05 * np.sin(3.1 * t)
    expected = 0.05 - 0.9 * alpha + 2.5 * alpha**3 - 1.2 * delta + 0.01 * rng.normal(size=len(t))
    columns = {"t": t, "alpha": np.degrees(alpha), "delta_e": np.degrees(delta), "C_m": expected}
    (folder / "map.toml").write_text(mapping)
    return [str(write(folder / "run.csv", columns)), "aero", "--map", str(folder / "map.toml")]


def test_orthogonal_functions_choose_the_terms_of_the_truth(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert identify.run([*moments(tmp_path), "--json", "--report", str(tmp_path / "page.html")]) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    found = {one["name"]: one for one in fit["estimates"]}
    assert fit["method"] == "regression of C_m, multivariate orthogonal functions"
    for name, true in {"alpha": -0.9, "alpha^3": 2.5, "delta_e": -1.2}.items():
        assert abs(found[name]["value"] - true) < 1.6 * (found[name]["high"] - found[name]["value"])
        assert found[name]["value"] == pytest.approx(true, rel=0.05)
    shares = [one for one in fit["notes"] if one.startswith("orthogonal function of")]
    assert len(shares) == 7 and sum("not kept" in one for one in shares) >= 2
    (held,) = [one for one in fit["outputs"] if one["held_out"]]
    assert held["theil"] < 0.05
    assert ">Orthogonal functions of <i>C</i><sub>m</sub></h" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("true", "expected"), [(0.0, False), (0.12, True)])
def test_a_term_that_is_worth_less_than_it_costs_but_no_chance_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], true: float, expected: bool
) -> None:
    """Its part is in the others, as what a pitch rate does to the lift is in that of alpha and the elevator."""
    rng, t = np.random.default_rng(3), np.arange(0, 20, 0.02)
    columns = {"t": t, **{name: rng.normal(size=len(t)) for name in ("a", "b", "d")}}
    columns["d"] = 0.7 * columns["b"] + columns["d"]
    columns["y"] = 5.0 * columns["a"] + 0.5 * columns["b"] + true * columns["d"] + 0.5 * rng.normal(size=len(t))
    signals = "".join(f'{name} = {{ column = "{name}", unit = "-" }}\n' for name in "abdy")
    mapping = (
        f'[time]\ncolumn = "t"\n[signals]\n{signals}[[aero.regressions]]\nresponse = "y"\nmethod = "orthogonal"\n'
    )
    (tmp_path / "map.toml").write_text(mapping + 'regressors = ["a", "b", "d"]\n')
    table = str(write(tmp_path / "run.csv", columns))
    assert identify.run([table, "aero", "--map", str(tmp_path / "map.toml"), "--json"]) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    assert "d" not in [one["name"] for one in fit["estimates"]]
    assert (("omitted_function", "d") in [(o["code"], o["subject"]) for o in fit["findings"]]) is expected


def test_orthogonal_functions_take_no_other_choice_beside_them(tmp_path: Path) -> None:
    for line in ('selection = "stepwise"', 'domain = "frequency"'):
        with pytest.raises(InputError, match="is in the time domain, without selection of terms"):
            identify.run(moments(tmp_path, ORTHOGONAL + line + "\n"))
    with pytest.raises(
        InputError, match=r"method = 'orthogonl' is not known; known: equation_error_time, .*orthogonal"
    ):
        identify.run(moments(tmp_path, ORTHOGONAL.replace('"orthogonal"', '"orthogonl"')))


def zoh_flight() -> dict[str, np.ndarray]:
    """The flight of an elevator that is held from each sample to the next, exact."""
    columns = flight()
    a = np.array([[TRUTH["Z_alpha"], 1.0], [TRUTH["M_alpha"], TRUTH["M_q"]]])
    b = np.array([[TRUTH["Z_delta"]], [TRUTH["M_delta"]]])
    f, g, *_ = cont2discrete((a, b, np.eye(2), np.zeros((2, 1))), float(columns["t"][1] - columns["t"][0]))
    delta = columns["delta_e"] + 0.02
    states = np.zeros((len(delta), 2))
    for k in range(len(delta) - 1):
        states[k + 1] = f @ states[k] + g[:, 0] * delta[k]
    # The force answers the elevator as it was until the sample, and at the first as it is.
    force = TRUTH["Z_alpha"] * states[:, 0] + TRUTH["Z_delta"] * np.concatenate((delta[:1], delta[:-1]))
    noise = np.random.default_rng(3).normal(size=(len(delta), 3)) * [2e-4, 3e-4, 1e-2]
    alpha, q, a_z = np.column_stack((states[:, 0] + 0.05, states[:, 1], 100.0 * force - 9.80665)).T + noise.T
    return {**columns, "alpha": alpha, "q": q, "a_z": a_z}


def test_an_input_that_was_held_is_told_with_the_word_that_mends_it(tmp_path: Path) -> None:
    """GIVEN samples 40 ms apart THEN a line between them puts M_q off by per cents; held, all is in its interval."""
    expected = ("", 'hold = ["delta_e"]\n', 'hold = ["delta_e"]\ndelay = "free"\n')
    plain, *right = (identified(tmp_path, zoh_flight(), BASE + more).fits[0] for more in expected)
    assert [one.subject for one in plain.findings if one.code == "zoh_input"] == ["delta_e"]
    assert abs({e.name: e.value for e in plain.estimates}["M_q"] / TRUTH["M_q"] - 1.0) > 0.01
    for one in right:
        assert "zoh_input" not in codes(one)
        for estimate in one.estimates:
            assert estimate.contains(TRUTH.get(estimate.name, 0.0)), estimate


def test_what_is_held_or_late_must_be_an_input_and_by_a_second_at_most(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown key zoh_inputs delta \(meant 'delta_e'\?\)"):
        identified(tmp_path, zoh_flight(), BASE + 'hold = ["delta"]\n')
    with pytest.raises(InputError, match="delay = 5 s: an input acts at most 1 s late or early"):
        identified(tmp_path, zoh_flight(), BASE + "delay = 5\n")


def test_a_moved_control_does_not_jump() -> None:
    time = np.arange(0.0, 10.0, 0.04)
    smooth = np.sin(2.0 * time)
    assert not jumps(smooth) and not jumps(np.zeros(100)) and not jumps(np.random.default_rng(1).normal(size=200))
    assert jumps(np.sign(np.sin(2.0 * time + 0.1)))
