"""`wingbeat identify FLIGHT path`: sensors' errors from a table and from a log, by the command."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from prescribed_flight import ERRORS, PLACES, Flight, measured

from avionics import messages as m
from avionics import topics
from groundstation.command import identify
from groundstation.command.main import main
from logs.identification.data.experiment import Experiment
from logs.identification.sources.table.config import SUBJECTS, example_map, load_map
from tests.logs.recorded import record

LONGITUDINAL = ("q", "a_x", "a_z", "airspeed", "alpha", "theta", "altitude")
UNITS = {"q": "deg/s", "p": "deg/s", "r": "deg/s", "a_x": "g", "a_y": "g", "a_z": "g", "airspeed": "kn",
         "alpha": "deg", "theta": "deg", "phi": "deg", "altitude": "ft"}  # fmt: skip
FACTORS = {"deg/s": np.degrees(1.0), "deg": np.degrees(1.0), "g": 1 / 9.80665, "kn": 3600 / 1852, "ft": 1 / 0.3048}
PLACED = "[path.places]"
MAP = """
[time]
column = "t"
[signals]
{signals}
[maneuvers]
validate = {validate}
[path.places]
imu = [0.3, 0.05, -0.1]
airspeed = [1.2, -0.5, 0.0]
alpha = [1.5, 0.4, 0.1]
{more}
"""


def write(path: Path, simulated: Experiment, names: tuple[str, ...]) -> None:
    columns = {name: simulated.signals[name] * FACTORS[UNITS[name]] for name in names}
    rows = np.column_stack((simulated.time, *columns.values()))
    path.write_text(
        ",".join(("t", *names)) + "\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows)
    )


def signals(names: tuple[str, ...]) -> str:
    lines = [
        f'{"V" if name == "airspeed" else name} = {{ column = "{name}", unit = "{UNITS[name]}" }}' for name in names
    ]
    return "\n".join(lines)


def tables(folder: Path, count: int = 2, validate: str = "[2]", more: str = "", **changed: Any) -> list[str]:
    """Command's words for flights of the longitudinal motion."""
    files = []
    for seed in range(count):
        flight = Flight(seed=seed + 11, longitudinal=True, duration=16)._replace(**changed)
        write(folder / f"run{seed + 1}.csv", measured(flight), LONGITUDINAL)
        files.append(str(folder / f"run{seed + 1}.csv"))
    (folder / "map.toml").write_text(MAP.format(signals=signals(LONGITUDINAL), validate=validate, more=more))
    return [*files, "--map", str(folder / "map.toml"), "path"]


def inside(entries: list[Mapping[str, Any]], truth: Mapping[str, float], wider: float = 1.0) -> list[bool]:
    """Whether each truth lies in its interval, made ``wider``."""
    found = []
    for one in entries:
        middle, half = one["value"], wider * (one["high"] - one["value"])
        found.append(abs(truth[one["name"]] - middle) <= half)
    return found


def test_a_table_tells_its_sensors_errors_and_predicts_the_flight_held_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = tables(tmp_path)
    assert main(["identify", *words, "--json", "--report", str(tmp_path / "page.html")]) == 0
    document = json.loads(capsys.readouterr().out)
    (fit,) = document["fits"]
    assert fit["subject"] == "path" and fit["converged"] and not fit["failure"]
    assert {one["name"] for one in fit["estimates"]} == {
        "bias_q", "bias_a_x", "bias_a_z", "bias_alpha", "scale_alpha",
    }  # fmt: skip
    assert sum(inside(fit["estimates"], ERRORS)) >= 4 and all(inside(fit["estimates"], ERRORS, 1.8))
    assert fit["notes"][0].startswith("not measured: p, r, a_y; the longitudinal motion alone")
    held = [one for one in fit["outputs"] if one["held_out"]]
    assert {one["output"] for one in held} == {"airspeed", "alpha", "theta", "altitude"}
    assert all(one["theil"] < 0.1 for one in held)
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    for title in (
        "Reconstructed motion",
        "Measured and modeled outputs",
        "Residuals",
        "Validation on held-out maneuvers",
    ):
        assert f">{title}</h" in page


def test_a_manoeuvre_without_a_whole_piece_is_left_out_and_the_others_are_fitted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = tables(tmp_path, validate="[]")
    lines = (tmp_path / "run2.csv").read_text().splitlines()
    for at in range(3, len(lines), 20):
        for row in range(at, min(at + 10, len(lines))):
            cells = lines[row].split(",")
            lines[row] = ",".join((*cells[:1], "", *cells[2:]))
    (tmp_path / "run2.csv").write_text("\n".join(lines))
    assert main(["identify", *words]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "left out: maneuver 2 of run2.csv: q, a_x, a_z are nowhere measured together" in said
    assert main(["identify", words[1], *words[2:]]) == 2
    assert "left out: maneuver 1 of run2.csv" in capsys.readouterr().err


def test_gaps_of_an_input_cut_the_record_and_the_rest_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = tables(tmp_path, count=1, validate="[]")
    lines = (tmp_path / "run1.csv").read_text().splitlines()
    for at in (100, 101, *range(400, 430)):
        cells = lines[at].split(",")
        lines[at] = ",".join((*cells[:1], "", *cells[2:]))
    (tmp_path / "run1.csv").write_text("\n".join(lines))
    assert main(["identify", *words]) == 0
    said = capsys.readouterr().out
    assert "32 samples without q, a_x, a_z, 2 of them bridged, 30 left out" in " ".join(said.split())
    assert "bias_q" in said and "scale_alpha" in said


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (PLACED, f'[path]\nalso = ["scale_qq"]\n{PLACED}', "path.also scale_qq (meant 'scale_q'?)"),
        (PLACED, f"[path]\nlongitudinl = true\n{PLACED}", "path.longitudinl (meant 'longitudinal'?)"),
        ("imu = [0.3, 0.05, -0.1]", "imu = [0.3, 0.05]", "path.places.imu must be a list of 3"),
        (PLACED, f"[path]\nlongitudinal = false\n{PLACED}", "path needs signals.p, signals.r, signals.a_y"),
        ('V = { column = "airspeed", unit = "kn" }\n', "", "path needs signals.V"),
        (PLACED, f"[path]\ninput_noise = {{ q = 0.0 }}\n{PLACED}", "path.input_noise.q must be above 0"),
    ],
)
def test_a_map_that_cannot_be_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, expected: str
) -> None:
    words = tables(tmp_path, count=1, validate="[]")
    text = (tmp_path / "map.toml").read_text()
    assert old in text
    (tmp_path / "map.toml").write_text(text.replace(old, new))
    assert main(["identify", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line


def logged(path: Path, simulated: Experiment) -> Path:
    """A log of the flight as a flight computer writes it."""
    s, expected = simulated.signals, []
    for k, time in enumerate(simulated.time):
        at = round(time * 1e6) + 1000
        values = {name: float(column[k]) for name, column in s.items()}
        expected += [
            (topics.IMU, m.ImuSample(at, *(values[name] for name in ("a_x", "a_y", "a_z", "p", "q", "r")), 0, 0, 0)),
            (topics.ATTITUDE, of(m.Attitude, at, roll=values["phi"], pitch=values["theta"], yaw=values["psi"])),
            (topics.AIR_DATA, of(m.AirData, at, airspeed=values["airspeed"])),
            (topics.ALTITUDE, of(m.Altitude, at, altitude=values["altitude"], climb_rate=values["climb_rate"])),
            (topics.POSITION, of(m.Position, at, north=values["north"], east=values["east"])),
        ]
    return record(path, expected)


def of(message: Any, at: int, **fields: float) -> Any:
    """A message with these fields, the others zero."""
    return message(**dict.fromkeys(message._fields, 0) | {"time_us": at} | fields)


def test_a_log_tells_its_sensors_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN no vanes THEN the biases of the IMU are found behind the launch, and no wind."""
    places = PLACES._replace(imu=(0.0, 0.0, 0.0), airspeed=(0.0, 0.0, 0.0))
    errors = {"bias_p": 0.01, "bias_q": -0.006, "bias_r": 0.004}
    flight = Flight(seed=3, duration=18, errors=errors, places=places, wind=(2.0, -1.0))
    log = logged(tmp_path / "flight.mcap", measured(flight))
    assert main(["identify", str(log), "path", "--json", "--report", str(tmp_path / "page.html")]) == 0
    path = json.loads(capsys.readouterr().out)["path"]
    truth = {**dict.fromkeys(("bias_a_x", "bias_a_y", "bias_a_z"), 0.0), **flight.errors}
    assert {"bias_p", "bias_q", "bias_r"} <= {one["name"] for one in path["estimates"]}
    assert sum("bank error" in one["reason"] for one in path["unidentified"]) == 2
    assert "5.0 s to 18.0 s" in path["records"][0]
    assert all(inside(path["estimates"], truth, 1.8))
    assert np.mean(inside(path["estimates"], truth)) >= 0.75
    assert ">Reconstructed motion</h" in (tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_example_map_is_one_and_an_unknown_one_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for subject, example in ((name, example_map(name)) for name in SUBJECTS):
        assert identify.run(["--map-example", subject]) == 0
        assert capsys.readouterr().out == example
        (tmp_path / "map.toml").write_text(example)
        chosen = load_map(tmp_path / "map.toml")
        assert subject == "all" or getattr(chosen, subject) is not None
    assert main(["identify", "--map-example", "pth"]) == 2
    assert "no example map of 'pth' (meant 'path'?)" in capsys.readouterr().err


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("column", "value", "code"), [(4, "1e12", 0), (1, "1e12", 0), (7, "5e13", 0), (4, "", 2)])
def test_a_column_of_nonsense_gives_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], column: int, value: str, code: int
) -> None:
    """GIVEN a speed or rate beyond reason, or none THEN no warning, no traceback and no number of what it spoils."""
    words = tables(tmp_path, count=1, validate="[]")
    head, *rows = ((line.split(",")) for line in (tmp_path / "run1.csv").read_text().splitlines())
    spoilt = [head, *((*row[:column], value, *row[column + 1 :]) for row in rows)]
    (tmp_path / "run1.csv").write_text("\n".join(",".join(row) for row in spoilt))
    assert main(["identify", *words, "--json"]) == code
    said = capsys.readouterr()
    if code:
        assert len(said.err.splitlines()) == 1
    else:
        (fit,) = json.loads(said.out)["fits"]
        incompatible = any("worse than a constant" in note for note in fit["notes"])
        assert fit["failure"] or fit["unidentified"] or not fit["estimates"] or incompatible, fit


@pytest.mark.parametrize(("bank", "level"), [(0.01, True), (0.3, False)])
def test_a_measured_bank_is_a_finding_of_the_longitudinal_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], bank: float, level: bool
) -> None:
    """GIVEN bank measured, and p, r and a_y not THEN errors that the bank makes are marked."""
    simulated = measured(Flight(seed=3, longitudinal=True, duration=16))
    phi = bank * np.sin(0.7 * simulated.time) + 0.002 * np.random.default_rng(1).normal(size=len(simulated.time))
    q = simulated.signals["q"] + 9.80665 / 20.0 * np.sin(phi) * np.tan(phi)
    names = (*LONGITUDINAL, "phi")
    write(tmp_path / "run.csv", simulated._replace(signals={**simulated.signals, "phi": phi, "q": q}), names)
    (tmp_path / "map.toml").write_text(MAP.format(signals=signals(names), validate="[]", more=""))
    words = [str(tmp_path / "run.csv"), "--map", str(tmp_path / "map.toml"), "path", "--json"]
    assert identify.run(words) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    if level:
        assert all(inside(fit["estimates"], ERRORS, 1.6))
    assert any(note.startswith("measured bank of up to") for note in fit["notes"]) is not level


def test_an_unmeasured_bank_is_a_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a bank of the size said, not measured THEN it moves a bias by just about half its interval."""
    words = tables(tmp_path, count=1, validate="[]")
    assert main(["identify", *words, "--json"]) == 0
    (level,) = json.loads(capsys.readouterr().out)["fits"]
    (note,) = (one for one in level["notes"] if one.startswith("phi is not measured"))
    bank = np.radians(float(note.partition("steady bank of ")[2].partition(" deg")[0]))
    simulated = measured(Flight(seed=11, longitudinal=True, duration=16))
    s = simulated.signals
    turned = {
        "q": s["q"] + 9.80665 / s["airspeed"] * np.sin(bank) * np.tan(bank),
        "a_z": s["a_z"] + 9.80665 * (1.0 - np.cos(bank)) * np.cos(s["theta"]),
    }
    write(tmp_path / "run1.csv", simulated._replace(signals={**s, **turned}), LONGITUDINAL)
    assert main(["identify", *words, "--json"]) == 0
    (banked,) = json.loads(capsys.readouterr().out)["fits"]
    moved = []
    for before, after in zip(level["estimates"], banked["estimates"], strict=True):
        if before["name"] in ("bias_q", "bias_a_z"):
            moved.append((after["value"] - before["value"]) / (before["high"] - before["value"]))
    assert 0.8 < max(moved) < 1.2


def test_signals_that_are_not_of_one_motion_are_a_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a vane that swings by itself THEN its signal is incompatible."""
    simulated = measured(Flight(seed=3, longitudinal=True, duration=16, step=0.04))
    alpha = 0.08 + 0.05 * np.sin(4.5 * simulated.time)
    write(tmp_path / "run.csv", simulated._replace(signals={**simulated.signals, "alpha": alpha}), LONGITUDINAL)
    expected = signals(LONGITUDINAL)
    (tmp_path / "map.toml").write_text(MAP.format(signals=expected, validate="[]", more=""))
    words = [str(tmp_path / "run.csv"), "--map", str(tmp_path / "map.toml"), "path", "--json"]
    code = identify.run(words)
    said = capsys.readouterr()
    assert code == 0, said.err
    (fit,) = json.loads(said.out)["fits"]
    assert any("follow alpha worse than a constant" in note for note in fit["notes"])
