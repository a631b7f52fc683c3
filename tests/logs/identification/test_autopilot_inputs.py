"""Designed inputs as files of ArduPlane and PX4."""

from __future__ import annotations

import ast
import math
import re
import shutil
import subprocess
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
def test_scripts_have_the_input_and_valid_syntax(kind: str, tmp_path: Path) -> None:
    """GIVEN a doublet WHEN written as a script THEN its samples are the input, and the syntax is right."""
    text = text_of(kind, DOUBLET)
    values = values_in(text)
    assert values.max() == 0.1 and values.min() == -0.1 and len(values) == pytest.approx(120, abs=2)
    assert np.count_nonzero(values) == pytest.approx(20, abs=1) and not values[:49].any()
    assert "3 x doublet, 5.73 deg" in text
    if kind == "px4":
        ast.parse(text)
        return
    assert text.count("function") == 3 and not re.search(r"{[a-z]+[:}]", text)
    opened = len(re.findall(r"\b(?:function|then|do)\b", text)) - len(re.findall(r"\belseif\b", text))
    assert opened == len(re.findall(r"^\s*end|\bend$", text, re.M))
    compiler = shutil.which("luac") or shutil.which("luac5.3")
    if compiler:
        (tmp_path / "input.lua").write_text(text)
        subprocess.run([compiler, "-p", str(tmp_path / "input.lua")], check=True)


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
