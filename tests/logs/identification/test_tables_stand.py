"""`wingbeat identify RUN.csv stand`: coefficients from a load cell whose air load is known, by model and by tare."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from groundstation.command.main import main
from logs.identification.models.inverse_dynamics import states, wing_of
from logs.identification.models.load_cell import StandRun, stand_motion
from logs.identification.models.multibody import wing_air
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle

PLACE, AXES = np.array((0.02, 0.0, 0.07)), np.array([(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)])
TRUTH = {"C_L_0": 0.3, "C_L_theta_11_rate": -0.05, "C_T_0": -0.02, "C_T_theta_11^2": 0.3, "C_m_theta_11_rate": 0.02}
MAP = """
[time]
column = "t"
[signals]
Fx = { column = "Fx", unit = "N" }
Fy = { column = "Fy", unit = "N" }
Fz = { column = "Fz", unit = "N" }
Mx = { column = "Mx", unit = "N mm" }
My = { column = "My", unit = "N mm" }
Mz = { column = "Mz", unit = "N mm" }
flap = { column = "flap", unit = "deg" }
V = { column = "V", unit = "km/h" }
[constants]
alpha = 0.06
rho = 1.225
[stand]
vehicle = "slow_hawk"
place = [0.02, 0.0, 0.07]
axes = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
sign = -1
"""


@cache
def vehicle() -> SimulatedVehicle:
    return load_vehicle("slow_hawk")


def run(path: Path, airspeed: float, seconds: float = 1.6) -> Path:
    """A run at 5 Hz; the air's load by `TRUTH`, none in still air."""
    time = np.arange(round(seconds / 0.002)) * 0.002
    flap = 0.14 + 0.5 * np.sin(2 * np.pi * 5.0 * time)
    expected = StandRun(path.name, time, np.zeros((len(time), 6)), flap, airspeed, 0.06, 1.225, 5.0 * time)
    moved = stand_motion(vehicle(), expected)
    air, motion = wing_air(vehicle(), moved, 1.225), states(vehicle(), moved)
    size = air.pressure * wing_of(vehicle()).area if airspeed else np.zeros(len(time))
    load = np.zeros((len(time), 6))
    load[:, 2] = -size * (TRUTH["C_L_0"] + TRUTH["C_L_theta_11_rate"] * motion["theta_11_rate"])
    load[:, 0] = size * (TRUTH["C_T_0"] + TRUTH["C_T_theta_11^2"] * motion["theta_11"] ** 2)
    load[:, 4] = size * wing_of(vehicle()).chord * TRUTH["C_m_theta_11_rate"] * motion["theta_11_rate"]
    on_cell = load - air.load
    force, moment = on_cell[:, :3], on_cell[:, 3:] - np.cross(PLACE, on_cell[:, :3])
    noise = 0.02 * np.random.default_rng(5).normal(size=(len(time), 6)) * (1, 1, 1, 0.1, 0.1, 0.1)
    cell = np.hstack((-force @ AXES, -moment @ AXES)) + noise
    columns = np.column_stack(
        (time, cell[:, :3], 1000 * cell[:, 3:], np.degrees(flap), 3.6 * np.full(len(time), airspeed))
    )
    rows = "\n".join(",".join(f"{value:.8g}" for value in row) for row in columns)
    path.write_text("t,Fx,Fy,Fz,Mx,My,Mz,flap,V\n" + rows + "\n")
    return path


@pytest.mark.parametrize("tared", [False, True])
def test_a_stand_tells_the_wings_coefficients(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], tared: bool
) -> None:
    files = [run(tmp_path / "run.csv", 9.2)] + ([run(tmp_path / "tare.csv", 0.0)] if tared else [])
    (tmp_path / "map.toml").write_text(MAP + ("tare = 2\n" if tared else ""))
    words = ["identify", *map(str, files), "--map", str(tmp_path / "map.toml"), "stand", "--json"]
    assert main([*words, "--report", str(tmp_path / "page.html")]) == 0
    document = json.loads(capsys.readouterr().out)
    fits = document["fits"]
    assert document["manoeuvres"] == {"fitted": ["maneuver 1 of run.csv"], "held_out": []}
    assert [fit["method"].split()[0] for fit in fits] == ["C_L", "C_T", "C_m"]
    found = {one["name"]: one for fit in fits for one in fit["estimates"]}
    for name, true in TRUTH.items():
        half = found[name]["high"] - found[name]["value"]
        assert abs(found[name]["value"] - true) < max(2 * half, 0.02 * abs(true)), found[name]
        assert found[name]["value"] == pytest.approx(true, rel=0.1)
    said = fits[0]["notes"]
    assert said[0].endswith("maneuver 2 of tare.csv" if tared else "the vehicle's model") and "lift" in said[1]
    assert said[0].startswith("tail load subtracted by the vehicle's model")
    lift, thrust, up, forward = (float(one) for one in re.findall(r"(-?[\d.]+) N", said[1] + said[2]))
    assert lift == pytest.approx(up * np.cos(0.06) + forward * np.sin(0.06), rel=1e-3)
    assert thrust == pytest.approx(forward * np.cos(0.06) - up * np.sin(0.06), rel=1e-2)
    assert up == pytest.approx(4.224, rel=0.01) and "along the stream" in said[1] and "body axes" in said[2]
    assert fits[0]["steps"] and fits[0]["outputs"][0]["r_squared"] > 0.98
    assert ">Stepwise regression</h" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("slow_hawk", "slow_hauk", "unknown vehicle 'slow_hauk'"),
        ("[1, 0, 0]", "[1, 1, 0]", "the load cell's r_frd_from_cell is no rotation"),
        ("sign = -1", "sign = 2", "load_cell.sign must be 1 or -1"),
        ("sign = -1", "tare = 3", "load_cell.tare: there is no maneuver 3; there are 1"),
        ("sign = -1", "tare = 1", "no run is left besides the tare run"),
        ("alpha = 0.06", "", "load_cell needs signals.alpha or constants.alpha"),
        ("sign = -1", "sihn = -1", "load_cell.sihn (meant 'sign'?)"),
        ("sign = -1", 'candidates = ["theta_1"]', "load_cell.candidates theta_1 (meant 'theta_11'?)"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, expected: str
) -> None:
    assert old in MAP
    (tmp_path / "map.toml").write_text(MAP.replace(old, new))
    file = run(tmp_path / "run.csv", 9.2, 0.8)
    assert main(["identify", str(file), "--map", str(tmp_path / "map.toml"), "stand"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
