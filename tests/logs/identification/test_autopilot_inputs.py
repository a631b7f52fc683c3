"""Designed inputs as files of ArduPlane and PX4."""

from __future__ import annotations

import math
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from avionics.guidance.mission import Channel, Excitation, Shape
from groundstation.command import design
from logs.identification.input_design.autopilots import autopilot_file, suffix
from logs.importing.excitation import excitation_topic
from logs.importing.source import Series

DOUBLET = Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.10, 0.2, 1.0, 3)
SWEEP = Excitation(Channel.ELEVATOR, Shape.LOGARITHMIC_SWEEP, 0.06, 20.0, 1.0, 1, 0.3, 3.0)
MODEL = Path(__file__).parents[2] / "data" / "models" / "robo_raven_ii_d.toml"


def text_of(kind: str, excitation: Excitation) -> str:
    return autopilot_file(kind, excitation, 0.6, 1.0, 2.0, Path(f"input{suffix(kind)}"))


def values_in(text: str) -> np.ndarray:
    """Return the numbers of the table of values."""
    (table,) = re.findall(r"VALUES = [\[{][^\n]*\n(.*?)\n[\]}]", text, re.S)
    return np.array([float(word) for word in table.replace("\n", " ").split(",") if word.strip()])


def test_a_sweep_for_arduplane_is_a_script() -> None:
    """GIVEN a sweep WHEN written for ArduPlane THEN its script has the amplitude, the length and both ends faded."""
    values = values_in(text_of("ardupilot", SWEEP))
    assert np.abs(values).max() == pytest.approx(0.06, rel=0.02)
    assert len(values) == pytest.approx(20.0 / 0.02 + 100, abs=2)
    assert np.abs(values[50:60]).max() < 0.02 and np.abs(values[-60:-50]).max() < 0.03


@pytest.mark.parametrize("kind", ["ardupilot", "px4"])
def test_scripts_have_the_input(kind: str) -> None:
    """GIVEN a doublet WHEN written as a script THEN its samples are the input."""
    text = text_of(kind, DOUBLET)
    values = values_in(text)
    assert values.max() == 0.1 and values.min() == -0.1 and len(values) == pytest.approx(120, abs=2)
    assert np.count_nonzero(values) == pytest.approx(20, abs=1) and not values[:49].any()
    assert "3 x doublet, 5.73 deg" in text


ARDUPLANE = """
servo = { SERVO3_MIN = 1000, SERVO3_MAX = 2000, SERVO3_REVERSED = 0 }
switch, armed, trim, pulses, texts, logged = 0, true, 1520, {}, {}, {}
SRV_Channels = {
  find_channel = function(self, number) return number == 19 and 2 or nil end,
  get_output_pwm = function(self, number) return trim end,
  set_output_pwm_chan_timeout = function(self, channel, pulse, timeout)
    assert(math.type(pulse) == "integer" and channel == 2 and timeout > 0)
    pulses[#pulses + 1] = pulse
  end,
}
param = { get = function(self, name) return servo[name] end }
rc = { find_channel_for_option = function(self, option)
  assert(option == 300)
  return { get_aux_switch_pos = function(self) return switch end }
end }
arming = { is_armed = function(self) return armed end }
gcs = { send_text = function(self, level, text) texts[#texts + 1] = text end }
logger = { write = function(self, name, labels, format, value) logged[#logged + 1] = value end }
"""
"""what the script uses of ArduPilot's Lua interface"""


def arduplane(reversed_servo: int) -> tuple[Any, Any]:
    """Return the Lua state with the loaded script, and its first step."""
    lua53 = pytest.importorskip("lupa.lua53")
    state = lua53.LuaRuntime()
    state.execute(ARDUPLANE)
    state.globals().servo["SERVO3_REVERSED"] = reversed_servo
    update, delay = state.execute(text_of("ardupilot", DOUBLET))
    assert delay == 1000
    return state.globals(), update


@pytest.mark.parametrize("reversed_servo", [0, 1])
def test_the_arduplane_script_moves_the_servo(reversed_servo: int) -> None:
    """GIVEN the script in Lua 5.3 WHEN the switch is high THEN every repeat is the input times the servo's travel."""
    ardupilot, update = arduplane(reversed_servo)
    update, delay = update()
    assert delay == 100 and len(ardupilot.pulses) == 0  # the switch is low
    ardupilot.switch, delays = 2, []
    for _ in range(400):
        update, delay = update()
        delays.append(delay)
    values, sign = values_in(text_of("ardupilot", DOUBLET)), 1 - 2 * reversed_servo
    expected = np.tile(1520 + sign * 500.0 * values / 0.6, 3)
    assert np.array(list(ardupilot.pulses.values())) == pytest.approx(expected, abs=0.51)
    assert delays[: len(values)] == [*[20] * (len(values) - 1), 2000] and delays.count(2000) == 3
    assert 0.5 * np.array(list(ardupilot.logged.values())) == pytest.approx(np.tile(values, 3), abs=1e-3)
    factor = sign * 0.6 / 500.0
    assert list(ardupilot.texts.values()) == [f"input: started, RCOU.C3 {factor:.4g} rad/us", "input: done"]


@pytest.mark.parametrize("end", ["switch", "armed"])
def test_the_arduplane_script_stops(end: str) -> None:
    """GIVEN a running input WHEN the switch goes low or the motors are disarmed THEN it stops and starts anew."""
    ardupilot, update = arduplane(0)
    ardupilot.switch = 2
    for _ in range(55):
        update, _ = update()
    ardupilot[end] = 0 if end == "switch" else False
    update, delay = update()
    assert delay == 100 and len(ardupilot.pulses) == 55
    assert list(ardupilot.texts.values())[-1] == "input: stopped"
    ardupilot[end] = 2 if end == "switch" else True
    update, _ = update()
    assert len(ardupilot.pulses) == 56 and ardupilot.pulses[56] == 1520


def test_the_px4_script_sends_the_stick(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN the script for PX4 WHEN run on a link THEN the stick follows the input, and a change of mode stops it."""
    sent: list[tuple[int, ...]] = []

    class Link:
        target_system = 1

        class mav:  # noqa: N801
            manual_control_send = staticmethod(lambda *values: sent.append(values))

        def wait_heartbeat(self) -> Any:
            return SimpleNamespace(custom_mode=7, get_srcSystem=lambda: 1, get_srcComponent=lambda: 1)

        def recv_match(self, **_: Any) -> Any:
            """A camera of the vehicle has mode 0; then the vehicle itself changes its mode."""
            component = 1 if len(sent) > 150 else 100
            mode = 8 if component == 1 else 0
            return SimpleNamespace(custom_mode=mode, get_srcSystem=lambda: 1, get_srcComponent=lambda: component)

    names: dict[str, Any] = {"__name__": "input"}
    exec(compile(text_of("px4", DOUBLET), "input.py", "exec"), names)
    monkeypatch.setattr(names["mavutil"], "mavlink_connection", lambda url: Link())
    monkeypatch.setattr(names["sys"], "argv", ["input.py", "udpin:0.0.0.0:14550", "0.6"])
    monkeypatch.setattr(names["time"], "sleep", lambda seconds: None)
    with pytest.raises(SystemExit):
        names["main"]()
    pitch = np.array([one[1] for one in sent])
    assert len(sent) == 151 and {one[3] for one in sent} == {600}
    assert pitch.min() == -round(1000 * 0.1 / 0.6) and pitch.max() == round(1000 * 0.1 / 0.6)
    assert pitch[np.flatnonzero(pitch)[0]] < 0  # nose up first: a positive x is stick forward


def test_the_logged_input_of_the_script_is_imported() -> None:
    """GIVEN the message that the Lua script logs WHEN imported THEN the maneuvers have its amplitude in rad."""
    time = np.arange(0.0, 12.0, 0.02)
    values = np.where((time > 5.0) & (time < 5.2), 0.1, 0.0) - np.where((time >= 5.2) & (time < 5.4), 0.1, 0.0)
    stamps = np.rint(time * 1e6).astype(np.int64)
    made = excitation_topic({"EXCI": Series("EXCI", stamps, {"pitch": values / 0.5}, {})}, {})
    assert made is not None and made.series.columns["elevator"].max() == pytest.approx(0.1)


@pytest.mark.parametrize(("shape", "kind"), [("doublet", "ardupilot"), ("log_sweep", "ardupilot"), ("3211", "px4")])
def test_the_command_writes_them(shape: str, kind: str, tmp_path: Path) -> None:
    """GIVEN a model WHEN designed for an autopilot THEN a file with the amplitude of the design."""
    out = tmp_path / "input"
    assert design.run([str(MODEL), "--input", shape, "--amplitude", "4", "--out", str(out), "--format", kind]) == 0
    text = out.read_text(encoding="utf-8")
    assert values_in(text).max() == pytest.approx(math.radians(4.0), rel=0.02 if shape == "log_sweep" else 1e-3)
