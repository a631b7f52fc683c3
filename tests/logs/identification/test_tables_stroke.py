"""`wingbeat identify RUN.csv stroke`: coefficients of up- and down-stroke from a flapping run with known ones."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from groundstation.command.main import main
from logs.identification.estimators.stroke_coefficients import HIDDEN, Flight, stroke_fit
from logs.identification.models.stroke_averaged import Attitude
from logs.identification.models.wing_strokes import (
    Flapped,
    measured_strokes,
    planform_of,
    strokes_by_angle,
    wing_motion,
)

TRUTH = {"C_L_up": 0.35, "C_L_down": 0.95, "C_D_up": 0.12, "C_D_down": 0.21}
RATE, FLAPPING, DENSITY = 400.0, 4.87, 1.2
"""Hz, Hz, kg/m^3; these forces jump at every reversal, and between two samples nobody knows when"""
OUTLINE = ((0.05, 0.25), (0.35, 0.25), (0.6, 0.0))
MAP = """
[time]
column = "t"
[signals]
flap = { column = "flap", unit = "deg" }
force_x = { column = "Fx", unit = "N" }
force_z = { column = "Fz", unit = "gf" }
V = { column = "V", unit = "km/h" }
alpha = { column = "alpha", unit = "deg" }
elevator = { column = "elevator", unit = "deg" }
[maneuvers]
validate = VALIDATE
[constants]
rho = 1.2
[stroke]
planform = [[0.05, 0.25], [0.35, 0.25], [0.6, 0.0]]
MORE
"""


def forces(flap: np.ndarray, rate: np.ndarray, speed: np.ndarray, alpha: np.ndarray, lift: Any) -> np.ndarray:
    """(N, 2) N, forward and up; by a fine sum over the sections of both wings, lift coefficients (up, down)."""
    down, total = rate < 0, np.zeros((len(flap), 2))
    edges = np.linspace(0.05, 0.6, 101)
    for y, width in zip((edges[1:] + edges[:-1]) / 2, np.diff(edges), strict=True):
        area = np.interp(y, *zip(*OUTLINE, strict=True)) * width
        forward, normal = speed * np.cos(alpha), rate * y - speed * np.sin(alpha) * np.cos(flap)
        size = 0.5 * DENSITY * area * np.hypot(forward, normal)
        c_l = np.where(down, lift[1], lift[0])
        c_d = np.where(down, TRUTH["C_D_down"], TRUTH["C_D_up"])
        along = size * (-c_l * normal - c_d * forward)
        across = size * (c_l * forward - c_d * normal) * np.cos(flap)
        total += 2 * np.column_stack((along, across))
    return total


def run(path: Path, seed: int, lift_slope: float = 0.0, seconds: float = 6.0) -> None:
    """A run at 5 Hz whose stream, pitch and elevator change slowly."""
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, 1 / RATE)
    turn = 2 * np.pi * FLAPPING * t
    flap, rate = 0.1 + 0.5 * np.sin(turn), 0.5 * 2 * np.pi * FLAPPING * np.cos(turn)
    alpha = 0.12 + 0.06 * np.sin(1.3 * t + seed)
    elevator = 0.1 * np.sin(2.1 * t)
    speed = 8.0 + 0.6 * np.sin(0.7 * t + seed)
    more = lift_slope * (alpha + 0.3 * elevator)
    lift = (TRUTH["C_L_up"] + more, TRUTH["C_L_down"] + more) if not lift_slope else (more, 2 * more)
    air = forces(flap, rate, speed, alpha, lift) + 0.1 * rng.normal(size=(len(t), 2))
    columns = (t, np.degrees(flap), air[:, 0], -air[:, 1] * 1000 / 9.80665, speed * 3.6, np.degrees(alpha),
               np.degrees(elevator))  # fmt: skip
    rows = (",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True))
    path.write_text("t,flap,Fx,Fz,V,alpha,elevator\n" + "\n".join(rows) + "\n")


def measured(seed: int, rate: float, seconds: float, noise: float, step: float) -> Flapped:
    """Wings that flap unevenly, their angle with ``noise`` (rad) or rounded to the ``step`` (rad) of an encoder."""
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, 1 / rate)
    turn = 2 * np.pi * FLAPPING * (t + 0.04 * np.sin(1.9 * t))
    turning = 2 * np.pi * FLAPPING * (1 + 0.076 * np.cos(1.9 * t))
    flap = 0.1 + 0.6 * np.sin(turn) + 0.08 * np.sin(2 * turn + 0.4)
    slope = turning * (0.6 * np.cos(turn) + 0.16 * np.cos(2 * turn + 0.4))
    stream, alpha = np.full(len(t), 9.0), np.full(len(t), 0.1)
    air = forces(flap, slope, stream, alpha, (TRUTH["C_L_up"], TRUTH["C_L_down"]))
    expected = flap + noise * rng.normal(size=len(t))
    expected = np.round(expected / step) * step if step else expected
    return Flapped(t, expected, stream, alpha, air + 0.1 * rng.normal(size=air.shape), DENSITY)


@pytest.mark.parametrize(
    ("rate", "seconds", "noise", "step"),
    [
        (1000.0, 3.0, 0.01, 0.0),  # 0.6 deg: the slope over two samples is 14 rad/s off, as fast as the wing
        pytest.param(1000.0, 3.0, 0.0, np.radians(0.35), marks=pytest.mark.validate),  # an encoder of 10 bits
        pytest.param(400.0, 3.0, 0.003, 0.0, marks=pytest.mark.validate),
        pytest.param(
            100.0, 8.0, 0.0, 0.0, marks=pytest.mark.validate
        ),  # 21 samples to a stroke: a line between two is 1 % off, and 4 % at 10
        pytest.param(50.0, 12.0, 0.0, 0.0, marks=pytest.mark.validate),
        (50.0, 12.0, 0.01, 0.0),
    ],
)
def test_intervals_hold_at_any_noise_of_the_angle_and_any_rate(
    rate: float, seconds: float, noise: float, step: float
) -> None:
    held = []
    for seed in range(5):
        flown = measured(seed, rate, seconds, noise, step)
        strokes = measured_strokes(flown, planform_of(OUTLINE), strokes_by_angle(flown.time, flown.flap))
        still = np.zeros(len(strokes.begin))
        found = stroke_fit([Flight("run", strokes, Attitude(still, still, still))])[0].estimates
        assert len(found) == 4
        held += [one.contains(TRUTH[one.name]) for one in found]
        for one in found:
            assert one.value == pytest.approx(TRUTH[one.name], rel=0.02), (seed, one)
            assert one.high - one.low < 0.05 * TRUTH[one.name]
    assert sum(held) >= 16, sum(held)


def test_an_angle_of_noise_alone_is_said_to_hide_the_halves() -> None:
    flown = measured(0, 400.0, 3.0, 0.0, 0.0)
    noisy = flown._replace(flap=np.random.default_rng(0).normal(0.0, 0.5, len(flown.time)))
    strokes = measured_strokes(noisy, planform_of(OUTLINE), strokes_by_angle(flown.time, flown.flap))
    still = np.zeros(len(strokes.begin))
    lost = stroke_fit([Flight("run", strokes, Attitude(still, still, still))])[0].withheld
    assert len(lost) == 4 and {one.text for one in lost} == {HIDDEN}


def test_the_flap_rate_is_right_within_what_it_says() -> None:
    flown = measured(0, 1000.0, 3.0, 0.01, 0.0)
    exact = measured(0, 1000.0, 3.0, 0.0, 0.0)
    found, truth = wing_motion(flown.flap, 1e-3), wing_motion(exact.flap, 1e-3)
    wrong = found.rate - np.gradient(exact.flap, 1e-3, edge_order=2)
    assert 0.7 < float(np.std(wrong[100:-100])) / found.error < 1.4
    assert truth.error < 1e-2 * found.error
    holed = flown.flap.copy()
    holed[[700, 710]] = np.nan
    pieces = wing_motion(holed, 1e-3)
    assert np.isnan(pieces.rate[700:711]).all(), "nine samples are too few to tell a rate"
    assert float(np.std((pieces.rate - np.gradient(exact.flap, 1e-3, edge_order=2))[800:-100])) < 2 * found.error
    assert np.isnan(wing_motion(np.full(30, np.nan), 1e-3).rate).all()


def words(folder: Path, more: str = "", validate: str = "[]", count: int = 1, lift_slope: float = 0.0) -> list[str]:
    files = [folder / f"run{number}.csv" for number in range(1, count + 1)]
    for seed, file in enumerate(files):
        run(file, seed, lift_slope)
    (folder / "map.toml").write_text(MAP.replace("MORE", more).replace("VALIDATE", validate))
    return ["identify", *map(str, files), "--map", str(folder / "map.toml"), "stroke"]


def test_the_coefficients_of_both_halves_are_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = words(tmp_path, validate="[2]", count=2)
    assert main([*asked, "--json", "--report", str(tmp_path / "page.html")]) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    assert fit["subject"] == "stroke" and fit["converged"] and fit["samples"] in (28, 29)
    assert {one["name"] for one in fit["estimates"]} == set(TRUTH)
    for one in fit["estimates"]:
        truth = TRUTH[one["name"]]
        assert abs(one["value"] - truth) < max(1.6 * (one["high"] - one["value"]), 0.002), one
        assert one["value"] == pytest.approx(truth, abs=0.03)
    held = [one for one in fit["outputs"] if one["held_out"]]
    assert {one["output"] for one in held} == {"force_x", "force_z"} and all(one["theil"] < 0.05 for one in held)
    assert "strokes at 4.87 Hz" in fit["notes"][0]
    assert ">Strokes</h" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_lift_by_angle_of_attack_and_elevator(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words(tmp_path, 'derivatives = true\nelevator = "elevator"', lift_slope=3.0), "--json"]) == 0
    fits = json.loads(capsys.readouterr().out)["fits"]
    found = {one["name"]: one for one in fits[1]["estimates"]}
    for name, truth in {"C_L_up_alpha": 3.0, "C_L_up_elevator": 0.9, "C_L_down_alpha": 6.0}.items():
        assert abs(found[name]["value"] - truth) < max(
            1.6 * (found[name]["high"] - found[name]["value"]), 0.02 * truth
        )
        assert found[name]["value"] == pytest.approx(truth, rel=0.06)


def steady(folder: Path, capsys: pytest.CaptureFixture[str], turned: dict[int, float], seconds: float = 4.0) -> str:
    """What is said of a run in which nothing changes; ``turned``: factors of columns by their number."""
    flown = measured(0, 400.0, seconds, 0.0, 0.0)
    up = -1000 / 9.80665 * flown.force[:, 1]
    still = np.zeros(len(flown.time))
    columns = [
        flown.time,
        np.degrees(flown.flap),
        flown.force[:, 0],
        up,
        3.6 * flown.airspeed,
        np.degrees(flown.alpha),
        still,
    ]
    for number, factor in turned.items():
        columns[number] = factor * columns[number]
    asked = words(folder)
    rows = (",".join(f"{value:.8g}" for value in row) for row in zip(*columns, strict=True))
    (folder / "run1.csv").write_text("t,flap,Fx,Fz,V,alpha,elevator\n" + "\n".join(rows) + "\n")
    assert main(asked) == 0
    return " ".join(capsys.readouterr().out.split())


def test_a_steady_run_is_explained_and_not_doubted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = steady(tmp_path, capsys, {})
    assert "C_D_down" in said
    assert "explains" not in said and "is negative" not in said


@pytest.mark.parametrize(("turned", "drag"), [({1: -1.0}, "C_D_up"), ({3: -1.0}, "C_D_down"), ({2: -1.0}, "C_D_up")])
def test_a_signal_of_the_other_sign_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], turned: dict[int, float], drag: str
) -> None:
    assert f"{drag} is negative: air at rest would drive the wings" in steady(tmp_path, capsys, turned)


def test_coefficients_out_of_range_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = steady(tmp_path, capsys, {2: 1000 / 9.80665, 3: 1000 / 9.80665})
    assert "is larger than that of any wing (10)" in said


def test_strokes_with_missing_samples_are_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = words(tmp_path)
    lines = (tmp_path / "run1.csv").read_text().splitlines()
    lines[1000] = ",".join((*lines[1000].split(",")[:2], "", *lines[1000].split(",")[3:]))
    (tmp_path / "run1.csv").write_text("\n".join(lines))
    assert main(asked) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "1 with missing samples left out" in said and "C_L_down" in said


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("planform = [[0.05, 0.25], [0.35, 0.25], [0.6, 0.0]]", "", "stroke.planform is missing"),
        ("[0.35, 0.25]", "[0.05, 0.25]", "distance from the flapping axis"),
        ("rho = 1.2", "", "stroke needs constants.rho"),
        ('flap = { column = "flap"', 'wing = { column = "flap"', "stroke.flap = 'flap' is not in [signals]"),
        ('unit = "gf"', 'unit = "N m"', "signals.force_z is in N m; stroke.force_z must be in N"),
        ("[stroke]", "[stroke]\nderivative = true", "stroke.derivative (meant 'derivatives'?)"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, expected: str
) -> None:
    asked = words(tmp_path)
    text = (tmp_path / "map.toml").read_text()
    assert old in text
    (tmp_path / "map.toml").write_text(text.replace(old, new))
    assert main(asked) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
