"""A transmitter moved by a table: what it says when, and which tables are refused."""

from __future__ import annotations

from pathlib import Path

import pytest
from sensors_bench import cruise

from avionics.messages import Mode
from avionics.vehicles import load_vehicle
from sim_bridge.sensors.receiver import Sticks
from sim_bridge.sensors.transmitter import Script, load_script
from wingbeat.errors import InputError

TABLE = """# take off, hand over to the autopilot
time, arm, throttle, roll, mode
4, 1, 0, 0, 0

8.2, 1, 0.7, -0.5, 0
# whoever reads this
20, 1, 0.5, 0, 2
"""


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "sticks.csv"
    path.write_text(text)
    return path


def moved(script: Script, seconds: float) -> Sticks | None:
    return script.pilot()(cruise(0)._replace(time_us=round(seconds * 1e6)))


@pytest.mark.parametrize(
    ("seconds", "sticks"),
    [
        (0.0, Sticks()),
        (3.99, Sticks()),
        (4.0, Sticks(arm=1)),
        (8.19, Sticks(arm=1)),
        (8.2, Sticks(arm=1, throttle=0.7, roll=-0.5)),
        (19.9, Sticks(arm=1, throttle=0.7, roll=-0.5)),
        (500.0, Sticks(arm=1, throttle=0.5, mode=2)),
    ],
)
def test_what_a_line_says_holds_until_the_next(tmp_path: Path, seconds: float, sticks: Sticks) -> None:
    script = load_script(written(tmp_path, TABLE))
    assert moved(script, seconds) == sticks
    assert script.text == TABLE


@pytest.mark.parametrize("name", ["robo_raven_ii_d", "arizona_100cm"])
def test_the_names_of_the_mode_switch_are_the_modes_of_the_vehicle_files_that_come_along(
    tmp_path: Path, name: str
) -> None:
    gains = load_vehicle(name).gains.receiver
    numbers = gains.mode_low, gains.mode_middle, gains.mode_high
    rows = [f"{position},{Mode(number).name.lower()}" for position, number in enumerate(numbers)]
    script = load_script(written(tmp_path, "\n".join(["time,mode", *rows])))
    assert [sticks.mode for sticks in script.sticks] == [0, 1, 2]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "names the columns"),
        ("time,roll\n", "one for each time"),
        ("roll,pitch\n0,0\n", "columns are time and any of roll, pitch"),
        ("time,flaps\n0,0\n", "not time, flaps"),
        ("time,roll,roll\n0,0,0\n", "columns are"),
        ("time,roll\n0,0\n\n0,1\n", "must rise"),
        ("time,roll\n0,0\n# then\n1,0,0\n", "line 4 has 3 values for 2 columns"),
        ("time,roll\n0,1.5\n", "line 2: roll must be from -1 to 1, not 1.5"),
        ("time,throttle\n0,-0.5\n", "throttle must be from 0 to 1"),
        ("time,mode\n0,1.5\n", "mode must be a whole number from 0 to 2"),
        ("time,mode\n0,CRUISE\n", "mode must be a number or STABILIZED, LOITER, AUTO, not CRUISE"),
        ("time,mode\n0,3\n", r"mode must be a whole number from 0 to 2 \(STABILIZED, LOITER, AUTO\), not 3"),
        ("time,arm\n0,AUTO\n", "arm must be a number, not AUTO"),
        ("time,arm\n0,2\n", "arm must be a whole number from 0 to 1"),
        ("time,roll\nsoon,0\n", "time must be a number, not soon"),
        ("time,roll\n1,\n", "roll must be a number, not nothing"),
        ("time,roll\n1,nan\n", "roll must be a number"),
    ],
)
def test_a_table_that_nobody_can_fly_is_refused_in_one_line(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as refusal:
        load_script(written(tmp_path, text))
    assert "\n" not in str(refusal.value)
    assert "sticks.csv" in str(refusal.value)


def test_documented_stick_table_arms_with_the_throttle_closed_and_ends_in_auto(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "groundstation.md").read_text(encoding="utf-8")
    table = next(block for block in page.split("```\n") if block.startswith("time,arm,throttle"))
    script = load_script(written(tmp_path, table))
    armed = next(sticks for sticks in script.sticks if sticks.arm)
    assert armed.throttle == 0.0 and armed.mode == 0 and script.sticks[-1].mode == 2


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot read"):
        load_script(tmp_path / "nowhere.csv")
