"""From the log of a vibrating bird in the topics of PX4 to gains that fly the original bird."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wingbeat
from groundstation.command.main import dispatch
from logs.truth import known_truths
from sim_bridge.vehicles import load_vehicle

sys.path.insert(0, str(Path(__file__).parents[1] / "logs" / "importing"))
sys.path.insert(0, str(Path(__file__).parents[1] / "logs" / "identification"))

from closed_loop_flights import flight_tables
from foreign_logs import ulog

VEHICLE = "robo_raven_ii_d"
MISSION = Path(__file__).parents[2] / "avionics" / "missions" / "circuit.toml"
FREQUENCY = "short_period_frequency"


@pytest.mark.validate
def test_round_trip_of_a_vibrating_bird(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a vibrating bird's log as PX4's WHEN identified, shaken and tuned THEN model and gains fit the original.

    The short period is within 10 %, and every loop of the original keeps 6 dB and 45 degrees. It flies the
    mission and lands.
    """
    monkeypatch.chdir(tmp_path)
    text = (
        MISSION.read_text(encoding="utf-8")
        .replace("repeats = 1", "repeats = 4")
        .replace("repeats = 2", "repeats = 5")
    )
    Path("mission.toml").write_text(text, encoding="utf-8")
    log = wingbeat.fly(VEHICLE, "mission.toml", vibration=1.0, seed=3, log="own.mcap").log
    truth = known_truths(log, modes=True)[FREQUENCY]
    _write_px4(log, Path("flight.ulg"))
    run = _command(capsys)
    run("identify", "flight.ulg", "modes", "--vehicle", VEHICLE, "--model", "identified.toml")
    model = _toml("identified.toml")
    found, airspeed = float(model["identified"]["estimates"][FREQUENCY]["value"]), str(model["trim"]["airspeed"])
    assert found == pytest.approx(truth, rel=0.10)
    run("log", "import", "flight.ulg", "--to", "flight.mcap")
    run("log", "vibration", "flight.mcap", "--fit", "identified", "--out", "shaken")
    run("tune", "shaken", "--out", "tuned", "--no-fly", "--force")
    original = Path("original")
    original.mkdir()
    (original / "world.toml").write_text(
        load_vehicle(VEHICLE).text.replace(f'"{VEHICLE}"', '"original"', 1), encoding="utf-8"
    )
    shutil.copy(Path("tuned") / "avionics.toml", original / "avionics.toml")
    loops = json.loads(run("tune", "original", "--airspeed", airspeed, "--no-fly", "--json"))["loops"]
    margins = {
        one["name"]: (one["before"]["gain_margin"], np.degrees(one["before"]["phase_margin"])) for one in loops
    }
    print(f"\nshort period {found:.2f}, true {truth:.2f} rad/s; margins on the original {margins}")  # noqa: T201
    for name, (gain, phase) in margins.items():
        assert gain >= 6.0 and phase >= 45.0, name
    summary = wingbeat.fly("original", vibration=1.0, log="after.mcap").summary
    assert summary.landed is not None and summary.manoeuvres == 6


def _toml(path: str) -> Any:
    return tomllib.loads(Path(path).read_text(encoding="utf-8"))


def _command(capsys: pytest.CaptureFixture[str]) -> Any:
    def run(*words: str) -> str:
        capsys.readouterr()
        assert dispatch(list(words)) == 0
        return capsys.readouterr().out

    return run


def _write_px4(log: Any, path: Path) -> None:
    tables = flight_tables(log)
    actuators, inputs, wing = log["/mixing/actuators"], log["/guidance/excitation"], log["/main/wing"]
    torque = np.zeros((len(actuators.time), 3))
    torque[:, 1] = actuators["elevator"] / 0.5
    tables["vehicle_torque_setpoint"] = actuators["time_us"], {"xyz": torque}
    tables["excitation"] = inputs["time_us"][::2], {"pitch": inputs["elevator"][::2] / 0.5}
    tables["flap_frequency"] = wing["time_us"][::4], {"frequency_hz": wing["frequency"][::4]}
    path.write_bytes(ulog(tables))
