"""Joystick mapping, actions, MANUAL_CONTROL, calibration and settings files."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_joystick import CENTERED, RADIO, SETTINGS, FakeDevice
from hypothesis import given
from hypothesis import strategies as st

from avionics.link.dialect import mavlink
from avionics.link.services.manual import ManualService
from avionics.link.services.service import Sender
from avionics.messages import PilotInput
from groundstation.joystick.actions import Action, ActionKind, Assignments, ButtonState, parse_action, step
from groundstation.joystick.axes import (
    Axis,
    deflection,
    switch_position,
    throttle_full_travel,
    throttle_upper_half,
)
from groundstation.joystick.calibration import Assignment, build_settings, identify_stick, start_ranges
from groundstation.joystick.device import DeviceInfo, Reading
from groundstation.joystick.dialog import calibrate
from groundstation.joystick.settings import Settings, check_capabilities, find_settings, load_settings, read_settings
from groundstation.joystick.settings_text import merge, save_settings, settings_text
from groundstation.joystick.sticks import Sticks, manual_control
from groundstation.link import modes
from groundstation.link.vehicle_state import VehicleState
from wingbeat.documents import parse_toml
from wingbeat.errors import InputError

fraction = st.floats(0.0, 1.0)
raw = st.floats(-1.0, 1.0)


@st.composite
def axes(draw: st.DrawFn) -> Axis:
    low, high = draw(st.floats(-1.0, -0.3)), draw(st.floats(0.3, 1.0))
    center = draw(st.floats(low + 0.1, high - 0.1))
    return Axis(0, low, center, high, draw(st.booleans()), draw(st.floats(0.0, 0.5)), draw(fraction))


@given(axes(), raw, raw)
def test_axis_curves_are_monotone(axis: Axis, one: float, other: float) -> None:
    sign = -1.0 if axis.reversed else 1.0
    low, high = sorted((one, other))
    for curve in (deflection, throttle_full_travel, throttle_upper_half):
        assert sign * (curve(axis, high) - curve(axis, low)) >= -1e-12


@given(axes())
def test_axis_ends_and_center(axis: Axis) -> None:
    sign = -1.0 if axis.reversed else 1.0
    assert deflection(axis, axis.center) == 0.0
    assert deflection(axis, axis.max) == pytest.approx(sign) and deflection(axis, axis.min) == pytest.approx(-sign)
    bottom, top = (axis.max, axis.min) if axis.reversed else (axis.min, axis.max)
    for curve in (throttle_full_travel, throttle_upper_half):
        assert curve(axis, bottom) == 0.0 and curve(axis, top) == pytest.approx(1.0)
    assert throttle_upper_half(axis, axis.center) == 0.0


@given(axes(), raw)
def test_axis_curves_stay_in_range(axis: Axis, value: float) -> None:
    assert -1.0 <= deflection(axis, value) <= 1.0
    assert 0.0 <= throttle_full_travel(axis, value) <= 1.0
    assert 0.0 <= throttle_upper_half(axis, value) <= 1.0


@given(st.floats(0.01, 0.5), fraction)
def test_axis_deadzone_is_zero_and_continuous(deadzone: float, expo: float) -> None:
    axis = Axis(0, deadzone=deadzone, expo=expo)
    assert deflection(axis, 0.999 * deadzone) == deflection(axis, -0.999 * deadzone) == 0.0
    assert 0.0 < deflection(axis, deadzone + 1e-3) < 0.01
    assert throttle_full_travel(axis, -1.0 + 1.999 * deadzone) == 0.0


@given(fraction, st.floats(0.01, 0.99))
def test_axis_expo_is_cubic_and_odd(expo: float, value: float) -> None:
    axis = Axis(0, expo=expo)
    assert deflection(axis, value) == pytest.approx((1.0 - expo) * value + expo * value**3)
    assert deflection(axis, -value) == -deflection(axis, value)


def test_switch_positions_divide_the_range() -> None:
    assert [switch_position(value, 3) for value in (-1.0, -0.4, 0.0, 0.4, 1.0)] == [0, 0, 1, 2, 2]
    assert [switch_position(value, 2) for value in (-1.0, -0.1, 0.1, 1.0)] == [0, 0, 1, 1]


@given(raw, raw, raw, fraction)
def test_manual_control_arrives_as_it_was_sent(roll: float, pitch: float, yaw: float, throttle: float) -> None:
    """The message is read by the flight computer with the same signs."""

    class Clock:
        time_us = 0

    service, sender = ManualService(Clock(), 1), Sender(255, 190, 0, None)  # type: ignore[arg-type]
    (received,) = service.receive(manual_control(1, Sticks(roll, pitch, yaw, throttle)), sender, 0.0)
    assert isinstance(received, PilotInput)
    sent = (pitch, roll, yaw, throttle)
    assert (received.pitch, received.roll, received.yaw, received.throttle) == pytest.approx(sent, abs=5.1e-4)


def test_manual_control_has_no_buttons() -> None:
    message = manual_control(7, Sticks(0.5, -1.0, 0.25, 1.0))
    assert (message.target, message.x, message.y, message.z, message.r) == (7, 1000, 500, 1000, 250)
    assert message.buttons == 0


def test_unused_yaw_is_centered() -> None:
    without = SETTINGS._replace(yaw=None)
    assert without.sticks(Reading(CENTERED)) == (0.0, 0.0, 0.0, 0.0)
    assert list(without.axes()) == ["roll", "pitch", "throttle"]


# --- actions --------------------------------------------------------------------------------------------

ARM, MODE, KILL = Action(ActionKind.ARM), Action(ActionKind.MODE, "LOITER"), Action(ActionKind.KILL)


class Buttons:
    """Buttons and switches over time."""

    def __init__(self, assignments: Assignments) -> None:
        self._assignments = assignments
        self._state: ButtonState | None = None

    def step(self, now: float, *pressed: int, switch: float = -1.0) -> list[str]:
        reading = Reading((0.0, switch), frozenset(pressed))
        self._state, actions = step(self._state, self._assignments, reading, now)
        return [action.text() for action in actions]


def test_button_acts_once_when_pressed() -> None:
    buttons = Buttons(Assignments({0: ARM, 3: MODE}))
    assert buttons.step(0.0) == []
    assert buttons.step(0.1, 0) == ["arm"]
    assert buttons.step(0.2, 0, 3) == ["mode LOITER"]
    assert buttons.step(0.3, 0, 3) == buttons.step(0.4) == []


def test_button_pressed_at_connection_does_not_act() -> None:
    buttons = Buttons(Assignments({0: ARM, 1: Action(ActionKind.ARM_SWITCH)}, {1: (MODE, ARM)}))
    assert buttons.step(0.0, 0, 1, switch=1.0) == buttons.step(5.0, 0, 1, switch=1.0) == []
    assert buttons.step(5.1, 0) == ["disarm"]


def test_arm_switch_arms_and_disarms() -> None:
    buttons = Buttons(Assignments({1: Action(ActionKind.ARM_SWITCH)}))
    buttons.step(0.0)
    assert buttons.step(0.1, 1) == ["arm"] and buttons.step(0.2) == ["disarm"]


def test_kill_button_has_to_be_held_for_a_second() -> None:
    buttons = Buttons(Assignments({2: KILL}))
    buttons.step(0.0)
    assert buttons.step(0.1, 2) == buttons.step(1.0, 2) == buttons.step(1.05) == []
    assert buttons.step(2.0, 2) == buttons.step(2.9, 2) == []
    assert buttons.step(3.0, 2) == ["kill"]
    assert buttons.step(3.1, 2) == buttons.step(9.0, 2) == []


def test_switch_skips_positions_it_passes_through() -> None:
    actions = tuple(map(parse_action, ("mode MANUAL", "mode LOITER", "mode AUTO")))
    buttons = Buttons(Assignments({}, {1: actions}))
    assert buttons.step(0.0) == buttons.step(0.02, switch=0.0) == buttons.step(0.04, switch=1.0) == []
    assert buttons.step(0.2, switch=1.0) == ["mode AUTO"]
    assert buttons.step(0.3, switch=1.0) == buttons.step(0.4, switch=0.0) == []
    assert buttons.step(0.55, switch=0.0) == ["mode LOITER"]


@pytest.mark.parametrize(("autopilot", "name"), [(0, "STABILIZED"), (3, "FBWA"), (12, "STABILIZED")])
def test_mode_is_offered_under_the_name_of_the_autopilot(autopilot: int, name: str) -> None:
    state = VehicleState(autopilot=autopilot, vehicle_type=mavlink.MAV_TYPE_FIXED_WING)
    assert modes.equivalent(state, "stabilized") == name
    assert modes.equivalent(state, "no such mode") == "NO_SUCH_MODE"


# --- calibration ----------------------------------------------------------------------------------------


class Script:
    """A terminal at which the user moves the device before pressing Enter; a `dialog.Terminal`."""

    def __init__(self, device: FakeDevice, moves: list[list[tuple[float, ...]] | int | None]) -> None:
        self.lines: list[str] = []
        self._device, self._moves = device, moves
        self._waiting: list[tuple[float, ...]] = []
        self._is_new = True

    def print(self, text: str) -> None:
        self.lines.append(text)

    def entered(self) -> bool:
        if self._is_new:
            self._device.pressed.clear()
            move = self._moves.pop(0)
            self._is_new = False
            if isinstance(move, int):
                self._device.pressed.add(move)
                self._is_new = True
                return False
            self._waiting = list(move or [])
        if self._waiting:
            self._device.axes = list(self._waiting.pop(0))
            return False
        self._is_new = True
        return True

    def pause(self) -> None:
        pass


def test_calibration_measures_and_assigns() -> None:
    """GIVEN a transmitter with a reversed pitch WHEN every step is followed THEN the settings fly it."""
    info = DeviceInfo("Radio", "g" * 32, 5, 8)
    device = FakeDevice(info, (0.02, 0.0, -0.9, 0.0, -1.0))
    rest = (0.02, 0.0, -0.9, 0.0, -1.0)
    script = Script(
        device,
        [
            [(0.9, 1.0, 0.9, 0.8, 1.0), (-0.9, -1.0, -0.95, -0.8, -1.0), rest],
            [(0.88, 0.1, -0.9, 0.1, -1.0)],
            [(0.0, -0.97, -0.9, 0.0, -1.0)],
            [(0.0, 0.0, -0.9, 0.79, -1.0)],
            [(0.0, 0.0, 0.88, 0.0, -1.0)],
            5, None, None, None, None, None,
        ],
    )  # fmt: skip
    settings = calibrate(device, script, None)
    assert {stick: (axis.axis, axis.reversed) for stick, axis in settings.axes().items()} == {
        "roll": (0, False), "pitch": (1, True), "yaw": (3, False), "throttle": (2, False),
    }  # fmt: skip
    assert settings.assignments.buttons == {5: Action(ActionKind.ARM_SWITCH)}
    assert not settings.throttle_upper_half
    assert settings.sticks(Reading((0.9, -1.0, 0.9, -0.8, 0.0))) == pytest.approx((1.0, 1.0, -1.0, 1.0))
    assert settings.sticks(Reading(rest)) == (0.0, 0.0, 0.0, 0.0)
    assert read_settings(parse_toml(settings_text([settings]))) == (settings,)


def test_calibration_of_a_centered_throttle() -> None:
    center = Reading((0.0, 0.0, 0.0, 0.0))
    ranges = start_ranges(center).extended(Reading((1.0,) * 4)).extended(Reading((-1.0,) * 4))
    sticks = {name: Assignment(axis, axis == 1) for axis, name in enumerate(("roll", "pitch", "yaw", "throttle"))}
    settings = build_settings(DeviceInfo("Pad", "", 4, 10), ranges, center, sticks)
    assert settings.throttle_upper_half
    assert settings.sticks(Reading((0.0, 0.0, 0.0, -1.0))).throttle == 0.0
    assert settings.sticks(Reading((0.0, 0.0, 0.0, 1.0))).throttle == 1.0


def test_calibration_needs_a_clear_movement() -> None:
    center = Reading((0.0, 0.0))
    ranges = start_ranges(center).extended(Reading((1.0, 0.05))).extended(Reading((-1.0, -0.05)))
    assert identify_stick(ranges, center, Reading((0.3, 0.05)), ()) is None
    assert identify_stick(ranges, center, Reading((-0.9, 0.0)), ()) == (0, True)
    assert identify_stick(ranges, center, Reading((-0.9, 0.0)), (0,)) is None


def test_calibration_rejects_a_center_at_the_end() -> None:
    center = Reading((1.0, 0.0, 0.0))
    ranges = start_ranges(center).extended(Reading((-1.0, 1.0, 1.0))).extended(Reading((-1.0, -1.0, -1.0)))
    sticks = {name: Assignment(axis, False) for axis, name in enumerate(("roll", "pitch", "throttle"))}
    with pytest.raises(InputError, match="roll: axis 0 has its center at its end"):
        build_settings(DeviceInfo("Pad", "", 3, 0), ranges, center, sticks)


def test_calibration_ends_if_the_device_is_disconnected() -> None:
    device = FakeDevice()
    device.connected = False
    with pytest.raises(InputError, match="disconnected during the calibration"):
        calibrate(device, Script(device, []), None)


# --- settings -------------------------------------------------------------------------------------------

MINIMAL = """
[[device]]
name = "Pad"
roll = { axis = 0 }
pitch = { axis = 1 }
throttle = { axis = 2 }
"""


def test_settings_round_trip(tmp_path: Path) -> None:
    actions = Assignments({3: MODE, 0: ARM}, {4: (Action(ActionKind.NONE), KILL)})
    one = SETTINGS._replace(assignments=actions, yaw=None, throttle_upper_half=True, name='a "quoted" name')
    other = Settings("Pad", "", Axis(0, -0.9, 0.1, 0.8, True, 0.05, 0.4), Axis(1), Axis(2), Axis(3))
    file = tmp_path / "new" / "joystick.toml"
    assert save_settings(file, (one, other)) is None
    assert load_settings(file) == (one, other)
    changed = other._replace(roll=Axis(7))
    copy = save_settings(file, merge((one, other), changed))
    assert load_settings(file) == (one, changed)
    assert copy is not None and load_settings(copy) == (one, other)


def test_settings_are_found_by_guid_then_by_name() -> None:
    by_name = SETTINGS._replace(guid="")
    other = SETTINGS._replace(guid="f" * 32)
    assert find_settings((by_name, SETTINGS, other), RADIO) == SETTINGS
    assert find_settings((other, by_name), RADIO) == by_name
    assert find_settings((other,), RADIO) is None


def test_settings_have_defaults() -> None:
    (settings,) = read_settings(parse_toml(MINIMAL))
    assert settings.roll == Axis(0) and settings.yaw is None and not settings.throttle_upper_half
    assert settings.assignments == Assignments({}, {})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("[[device", "not valid TOML"),
        ("devices = 1", "unknown key devices (meant 'device'?); known: device"),
        ("[device]", "device must be written as [[device]]"),
        ("[[device]]", "device 1: roll is missing"),
        ('[[device]]\nname = "Pad"', "device Pad: roll is missing"),
        ('[[device]]\nname = 3', "device 3: name must be text in quotes, not 3"),
        (MINIMAL + "yaww = 1", "device Pad: unknown key yaww (meant 'yaw'?)"),
        (MINIMAL + "yaw = 3", "device Pad: yaw must be a section of keys, not 3"),
        (MINIMAL + "yaw = {}", "device Pad: yaw.axis is missing (0 to 255)"),
        (MINIMAL + "yaw = { axis = 1 }", "device Pad: axis 1 is assigned to pitch and to yaw"),
        (MINIMAL + "yaw = { axis = 1.5 }", "device Pad: yaw.axis must be a whole number (0 to 255), not 1.5"),
        (MINIMAL + "yaw = { axis = true }", "device Pad: yaw.axis must be a whole number"),
        (MINIMAL + "yaw = { axis = 3, exp = 1 }", "unknown key yaw.exp (meant 'expo'?)"),
        (MINIMAL + "yaw = { axis = 3, expo = 1.5 }", "device Pad: yaw.expo = 1.5 is outside 0 to 1"),
        (MINIMAL + "yaw = { axis = 3, deadzone = nan }", "yaw.deadzone must be a finite number (0 to 0.5), not nan"),
        (MINIMAL + 'yaw = { axis = 3, min = "a" }', "device Pad: yaw.min must be a number (-1 to 1), not 'a'"),
        (MINIMAL + "yaw = { axis = 3, center = 0.95 }", "min, center, max are -1, 0.95, 1; they must ascend by 0.1"),
        (MINIMAL + "yaw = { axis = 3, reversed = 1 }", "device Pad: yaw.reversed must be true or false, not 1"),
        (MINIMAL + 'yaw = { axis = 3, range = "full" }', "device Pad: unknown key yaw.range"),
        (MINIMAL.replace("axis = 2", 'axis = 2, range = "half"'), "'half' is not known; known: full, upper_half"),
        (MINIMAL + "buttons = 1", "device Pad: buttons must be a section of keys"),
        (MINIMAL + 'buttons = { a = "arm" }', "device Pad: buttons: 'a' is not a number from 0 to 255"),
        (MINIMAL + 'buttons = { 1 = "amr" }', "buttons.1: unknown action 'amr' (meant 'arm'?); known: arm, disarm"),
        (MINIMAL + "buttons = { 1 = 2 }", "device Pad: buttons.1 must be text in quotes, not 2"),
        (MINIMAL + "switches = 1", "device Pad: switches must be a section of keys"),
        (MINIMAL + 'switches = { 3 = ["arm"] }', "device Pad: switches.3 must be a list of 2 to 6 actions"),
        (MINIMAL + 'switches = { 3 = ["arm/disarm", "arm"] }', 'switches.3: "arm/disarm" is for buttons'),
        (MINIMAL + 'switches = { 2 = ["none", "kill"] }', "axis 2 is assigned to throttle and to a switch"),
        (MINIMAL + MINIMAL, "'Pad' has 2 tables [[device]]; keep one"),
    ],
)  # fmt: skip
def test_settings_errors_are_one_line(text: str, problem: str, tmp_path: Path) -> None:
    file = tmp_path / "joystick.toml"
    file.write_text(text)
    with pytest.raises(InputError) as caught:
        load_settings(file)
    line = str(caught.value)
    assert line.startswith(f"{file}: ") and problem in line and "\n" not in line


def test_settings_file_that_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "none.toml"
    assert load_settings(file, must_exist=False) == ()
    with pytest.raises(InputError, match="there is no such file"):
        load_settings(file)


def test_settings_beyond_the_device_are_rejected() -> None:
    with pytest.raises(InputError, match="its settings use axis 3, it has axes 0 to 2"):
        check_capabilities(SETTINGS, RADIO._replace(axes=3))
    with pytest.raises(InputError, match="its settings use button 24, it has 24 buttons"):
        check_capabilities(SETTINGS._replace(assignments=Assignments({24: ARM})), RADIO)
    check_capabilities(SETTINGS, RADIO)
