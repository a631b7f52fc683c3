"""Guided calibration of a device on the terminal: ranges, center, sticks, buttons."""

from __future__ import annotations

import queue
import sys
import threading
import time
from collections.abc import Callable
from typing import Protocol

from groundstation.joystick.actions import Action, ActionKind, parse_action
from groundstation.joystick.calibration import (
    Assignment,
    Ranges,
    build_settings,
    identify_stick,
    start_ranges,
)
from groundstation.joystick.device import Device, Reading
from groundstation.joystick.settings import OPTIONAL_STICKS, Settings
from wingbeat.errors import InputError

POLL = 0.02
"""s; between two readings"""
RANGE_STEP = (
    "1. Move every stick, dial and switch that sits on an axis to both ends, twice. Then release the sticks,"
    " pull a throttle without a spring to its lower end, and press Enter."
)
STICK_STEPS = {
    "roll": "roll: hold the stick fully to the right",
    "pitch": "pitch: pull the stick fully back (nose up)",
    "yaw": "yaw: hold the stick fully to the right (if there is none, leave it)",
    "throttle": "throttle: hold it at full throttle",
}
BUTTON_STEPS = {
    "arm/disarm": " (a switch of a transmitter: on arms, off disarms)",
    "arm": "",
    "disarm": "",
    "mode MANUAL": "",
    "mode STABILIZED": "",
    "mode LOITER": "",
    "return": "",
    "mode AUTO": "",
}
"""by the name of the action, what is added to it"""


class Terminal(Protocol):
    """Text to the user, and the Enter key."""

    def print(self, text: str) -> None:
        """Print a line."""

    def entered(self) -> bool:
        """Return whether Enter was pressed since the last call, without blocking.

        Raises:
            InputError: the input has ended.
        """

    def pause(self) -> None:
        """Let a little time pass."""


class StandardTerminal:
    """Standard input and output; reads in a thread, so that the device is read while Enter is awaited."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in sys.stdin:
            self._lines.put(line)
        self._lines.put("")

    def print(self, text: str) -> None:
        """Print a line."""
        print(text, flush=True)

    def entered(self) -> bool:
        """Return whether Enter was pressed since the last call, without blocking.

        Raises:
            InputError: the input has ended.
        """
        try:
            line = self._lines.get_nowait()
        except queue.Empty:
            return False
        if not line:
            raise InputError("--calibrate needs a terminal: the input ended before the calibration was complete")
        return True

    def pause(self) -> None:
        """Let a little time pass."""
        time.sleep(POLL)


def calibrate(device: Device, terminal: Terminal, previous: Settings | None) -> Settings:
    """Guide the user through the calibration of ``device``; what is not measured is kept from ``previous``.

    Raises:
        InputError: the device was disconnected, the input ended, or an axis has too little travel.
    """
    terminal.print(f"{device.info.name}: {device.info.axes} axes, {device.info.buttons} buttons")
    terminal.print(RANGE_STEP)
    ranges, center = _measure_ranges(device, terminal)
    terminal.print(f"   {len(ranges.moved())} axes with travel: {', '.join(map(str, ranges.moved())) or 'none'}")
    assignments: dict[str, Assignment] = {}
    for number, (stick, step) in enumerate(STICK_STEPS.items(), 2):
        terminal.print(f"{number}. {step}, and press Enter.")
        _assign(device, terminal, stick, ranges, center, assignments)
    used = [assignment.axis for assignment in assignments.values()]
    free = ", ".join(str(axis) for axis in ranges.moved() if axis not in used)
    if free:
        terminal.print(f"   axes with travel and no stick: {free}; switches on them go to [device.switches]")
    buttons = _assign_buttons(device, terminal, len(STICK_STEPS) + 2)
    settings = build_settings(device.info, ranges, center, assignments, previous)
    if not buttons:
        return settings
    return settings._replace(assignments=settings.assignments._replace(buttons=buttons))


def _measure_ranges(device: Device, terminal: Terminal) -> tuple[Ranges, Reading]:
    ranges = start_ranges(_read(device))

    def extend(reading: Reading) -> bool:
        nonlocal ranges
        ranges = ranges.extended(reading)
        return False

    center = _read_until(device, terminal, extend)
    return ranges, center


def _assign(
    device: Device,
    terminal: Terminal,
    stick: str,
    ranges: Ranges,
    center: Reading,
    assignments: dict[str, Assignment],
) -> None:
    """Repeat the step until an axis is identified; an optional stick may have none."""
    while True:
        reading = _read_until(device, terminal)
        used = [assignment.axis for assignment in assignments.values()]
        assignment = identify_stick(ranges, center, reading, used)
        if assignment is not None:
            assignments[stick] = assignment
            terminal.print(f"   {stick} is axis {assignment.axis}{', reversed' if assignment.reversed else ''}")
            return
        if stick in OPTIONAL_STICKS:
            terminal.print(f"   no {stick} axis")
            return
        terminal.print(f"   no free axis is deflected by half of its travel: hold the {stick} stick, press Enter")


def _assign_buttons(device: Device, terminal: Terminal, number: int) -> dict[int, Action]:
    terminal.print(f"{number}. Buttons and switches: press the one for each action, or Enter for none.")
    buttons: dict[int, Action] = {}
    for name, hint in BUTTON_STEPS.items():
        action = parse_action(name)
        if action.kind in (ActionKind.ARM, ActionKind.DISARM) and Action(ActionKind.ARM_SWITCH) in buttons.values():
            continue
        terminal.print(f"   {name}{hint}?")
        button = _pressed_button(device, terminal, frozenset(buttons))
        if button is not None:
            buttons[button] = action
            terminal.print(f"   {name} is button {button}")
    return buttons


def _pressed_button(device: Device, terminal: Terminal, used: frozenset[int]) -> int | None:
    """Return the next button that is pressed and not ``used``; None if Enter is pressed first."""
    before, button = _read(device).pressed, None

    def is_new(reading: Reading) -> bool:
        nonlocal before, button
        button = min(reading.pressed - before - used, default=None)
        before = reading.pressed
        return button is not None

    _read_until(device, terminal, is_new)
    return button


def _read_until(
    device: Device, terminal: Terminal, is_enough: Callable[[Reading], bool] = lambda reading: False
) -> Reading:
    """Read the device until Enter is pressed or a reading is enough; return the last reading."""
    while True:
        reading = _read(device)
        if is_enough(reading) or terminal.entered():
            return reading
        terminal.pause()


def _read(device: Device) -> Reading:
    reading = device.read()
    if reading is None:
        raise InputError(f"joystick {device.info.name} was disconnected during the calibration")
    return reading
