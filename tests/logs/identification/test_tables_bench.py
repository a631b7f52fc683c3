"""`wingbeat identify BENCH.csv torque_speed|twist`: constants of a servo and of a wing's twist from a bench."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from groundstation.command.main import main

STALL, SPEED, NOMINAL = 2.25, 20.5, 8.0
NATURAL, DAMPING = 60.0, 0.18
SERVO_MAP = """
[time]
rate = 1.0
[signals]
torque = { column = "torque", unit = "mN m" }
speed = { column = "speed", unit = "deg/s" }
voltage = { column = "supply", unit = "V" }
[maneuvers]
rows = [[1, 150], [151, 200]]
validate = [2]
[torque_speed]
voltage = "voltage"
nominal = 8.0
"""
TWIST_MAP = """
[time]
column = "t"
[signals]
twist = { column = "twist", unit = "deg" }
[maneuvers]
windows = [[0.0, 0.6], [1.0, 1.6], [2.0, 2.6]]
validate = [3]
[twist]
signal = "twist"
"""


def servo(folder: Path, slack: bool = False) -> list[str]:
    """Steady readings of a servo at full drive, both ways round; where ``slack`` it was not."""
    rng = np.random.default_rng(4)
    speed = rng.uniform(0, 16, 200) * np.sign(rng.normal(size=200))
    voltage = NOMINAL + 0.5 * rng.normal(size=200)
    torque = np.sign(speed) * (STALL * voltage / NOMINAL - STALL / SPEED * np.abs(speed))
    if slack:
        torque = 0.4 * np.sign(speed)
    torque = torque + 0.02 * rng.normal(size=200)
    table = np.column_stack((torque * 1000, np.degrees(speed), voltage))
    rows = "\n".join(",".join(f"{value:.8g}" for value in row) for row in table)
    (folder / "bench.csv").write_text("torque,speed,supply\n" + rows + "\n")
    (folder / "map.toml").write_text(SERVO_MAP)
    return ["identify", str(folder / "bench.csv"), "--map", str(folder / "map.toml"), "torque_speed"]


def released(folder: Path) -> list[str]:
    """Three releases from 8 degrees, 0.2 s after each window begins."""
    rng, t = np.random.default_rng(2), np.arange(0, 2.7, 0.002)
    damped = NATURAL * np.sqrt(1 - DAMPING**2)
    twist = np.full(len(t), 1.0)
    for begin in (0.0, 1.0, 2.0):
        held, free = (t >= begin) & (t < begin + 0.1), t >= begin + 0.1
        since = t[free] - begin - 0.1
        swing = np.exp(-DAMPING * NATURAL * since)
        turned = np.cos(damped * since) + DAMPING / np.sqrt(1 - DAMPING**2) * np.sin(damped * since)
        twist[held], twist[free] = 9.0, 1.0 + 8.0 * swing * turned
    twist += 0.05 * rng.normal(size=len(t))
    rows = "\n".join(f"{a:.6g},{b:.8g}" for a, b in zip(t, twist, strict=True))
    (folder / "bench.csv").write_text("t,twist\n" + rows + "\n")
    (folder / "map.toml").write_text(TWIST_MAP)
    return ["identify", str(folder / "bench.csv"), "--map", str(folder / "map.toml"), "twist"]


def test_a_bench_tells_the_servo_s_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*servo(tmp_path), "--json", "--report", str(tmp_path / "page.html")]) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    truth = {"stall_torque": STALL, "no_load_speed": SPEED, "torque_speed_slope": STALL / SPEED}
    assert {one["name"] for one in fit["estimates"]} == set(truth)
    for one in fit["estimates"]:
        assert abs(one["value"] - truth[one["name"]]) < 1.6 * (one["high"] - one["value"])
        assert one["value"] == pytest.approx(truth[one["name"]], rel=0.01)
    assert [one["held_out"] for one in fit["outputs"]] == [False, True]
    assert fit["outputs"][1]["theil"] < 0.02 and "the numbers are for 8 V" in fit["notes"]
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert ">Torque and speed</h" in page and "Validation on held-out" in page


def test_a_servo_that_was_not_driven_hard_has_no_number(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(servo(tmp_path, slack=True)) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "torque-speed line: no numbers" in said and "the servo was not at its bound" in said
    assert "stall_torque 2" not in said


def test_a_bench_whose_supply_was_not_told_apart_has_no_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = servo(tmp_path)
    rows = [line.split(",") for line in (tmp_path / "bench.csv").read_text().splitlines()]
    expected = [",".join(rows[0]), *(f"{torque},{speed},0" for torque, speed, _ in rows[1:])]
    (tmp_path / "bench.csv").write_text("\n".join(expected))
    assert main(words) == 0
    assert "voltage and rate do not vary apart" in " ".join(capsys.readouterr().out.split())


def test_a_release_tells_frequency_and_damping_and_predicts_another(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*released(tmp_path), "--json"]) == 0
    fits = json.loads(capsys.readouterr().out)["fits"]
    truth = {"twist_natural_frequency": NATURAL, "twist_damping": DAMPING}
    assert len(fits) == 2
    for fit in fits:
        found = {one["name"]: one for one in fit["estimates"]}
        for name, true in truth.items():
            assert abs(found[name]["value"] - true) < 1.8 * (found[name]["high"] - found[name]["value"])
            assert found[name]["value"] == pytest.approx(true, rel=0.03)
    (held,) = [one for fit in fits for one in fit["outputs"] if one["held_out"]]
    assert held["r_squared"] > 0.99 and held["experiment"].startswith("maneuver 3")


@pytest.mark.parametrize(
    ("bench", "old", "new", "expected"),
    [
        (servo, "nominal", "nominl", "torque_speed.nominl (meant 'nominal'?)"),
        (servo, 'unit = "deg/s"', 'unit = "N"', "signals.speed is in N; torque_speed.speed must be in rad/s"),
        (servo, "nominal = 8.0", "nominal = -8.0", "torque_speed.nominal = -8 V must be above 0"),
        (servo, 'voltage = "voltage"\nnominal = 8.0', "", "needs voltage (a signal) or nominal"),
        (
            released,
            'signal = "twist"',
            'signal = "tvist"',
            "twist.signal = 'tvist' is not in [signals] (meant 'twist'?)",
        ),
        (released, 'unit = "deg" }', 'unit = "N" }', "signals.twist is no angle and no rate"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bench: object, old: str, new: str, expected: str
) -> None:
    assert callable(bench)
    words = bench(tmp_path)
    text = (tmp_path / "map.toml").read_text()
    assert old in text
    (tmp_path / "map.toml").write_text(text.replace(old, new))
    assert main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
