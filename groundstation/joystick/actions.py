"""Actions of buttons and switches: their names in the settings file and the edges that trigger them."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import Any, NamedTuple

from groundstation.joystick.axes import switch_position
from groundstation.joystick.device import Reading
from groundstation.link.modes import canonical
from wingbeat.errors import InputError
from wingbeat.schema import error_context, read_value
from wingbeat.text import did_you_mean

KILL_TIME = 1.0
"""s; a kill button acts after it was pressed for this time"""
DEBOUNCE_TIME = 0.1
"""s; a switch acts after its position was constant for this time, so that passed positions have no effect"""
_MODE = "mode "


class ActionKind(StrEnum):
    """Kinds of actions, with their names in the settings file."""

    ARM = "arm"
    DISARM = "disarm"
    ARM_SWITCH = "arm/disarm"
    RETURN = "return"
    LAND = "land"
    KILL = "kill"
    NONE = "none"
    MODE = "mode"


class Action(NamedTuple):
    """One action."""

    kind: ActionKind
    mode: str = ""
    """-; name of the mode for MODE, else empty"""

    def text(self) -> str:
        """Name in the settings file: ``arm``, ``mode LOITER``."""
        return f"{_MODE}{self.mode}" if self.kind is ActionKind.MODE else str(self.kind)

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Action:
        """Parse an action in the settings file; `wingbeat.schema.read_record` calls this.

        Raises:
            InputError: unknown name.
        """
        text = read_value(str, entry, key)
        with error_context(key):
            return parse_action(text)


NAMES = (*(str(kind) for kind in ActionKind if kind is not ActionKind.MODE), "mode NAME")


def parse_action(text: str) -> Action:
    """Parse the name of an action.

    Raises:
        InputError: unknown name.
    """
    if text.startswith(_MODE) and text.removeprefix(_MODE).strip():
        return Action(ActionKind.MODE, canonical(text.removeprefix(_MODE).strip()))
    if text not in NAMES[:-1]:
        raise InputError(f"unknown action {text!r}{did_you_mean(text, NAMES)}; known: {', '.join(NAMES)}")
    return Action(ActionKind(text))


class Assignments(NamedTuple):
    """Actions of the buttons and switches of a device."""

    buttons: Mapping[int, Action] = {}
    """by button number"""
    switches: Mapping[int, tuple[Action, ...]] = {}
    """by axis number; one action for each position, from the lower end of the axis"""


class SwitchState(NamedTuple):
    """Position of one switch."""

    position: int
    """-; last position that acted, from 0"""
    candidate: int
    """-; of the last reading"""
    since: float
    """s; when the candidate was first read"""


class ButtonState(NamedTuple):
    """Buttons and switches as of the last reading."""

    pressed: frozenset[int]
    switches: tuple[SwitchState, ...]
    kill_since: Mapping[int, float]
    """s; by button number, when a kill button was pressed, until it has acted"""


def step(
    state: ButtonState | None, assignments: Assignments, reading: Reading, now: float
) -> tuple[ButtonState, tuple[Action, ...]]:
    """Return the new state and the actions that ``reading`` at time ``now`` (s) triggers.

    Nothing is triggered by the first reading: a switch that is on when the device is connected has to be moved.
    """
    positions = tuple(
        switch_position(reading.axes[axis], len(actions)) for axis, actions in assignments.switches.items()
    )
    if state is None:
        return ButtonState(reading.pressed, tuple(SwitchState(one, one, now) for one in positions), {}), ()
    switches, moved = _step_switches(state, assignments, positions, now)
    kill_since, killed = _step_kill(state, assignments, reading, now)
    changed = _changed_buttons(state, assignments, reading)
    return ButtonState(reading.pressed, switches, kill_since), (*killed, *changed, *moved)


def _changed_buttons(state: ButtonState, assignments: Assignments, reading: Reading) -> tuple[Action, ...]:
    actions: list[Action] = []
    for button, action in assignments.buttons.items():
        was, now = button in state.pressed, button in reading.pressed
        if was == now or action.kind is ActionKind.KILL:
            continue
        if action.kind is ActionKind.ARM_SWITCH:
            actions.append(Action(ActionKind.ARM if now else ActionKind.DISARM))
        elif now:
            actions.append(action)
    return tuple(actions)


def _step_kill(
    state: ButtonState, assignments: Assignments, reading: Reading, now: float
) -> tuple[Mapping[int, float], tuple[Action, ...]]:
    since: dict[int, float] = {}
    actions: list[Action] = []
    for button, action in assignments.buttons.items():
        if action.kind is not ActionKind.KILL or button not in reading.pressed:
            continue
        if button not in state.pressed:
            since[button] = now
        elif button in state.kill_since:
            if now - state.kill_since[button] >= KILL_TIME:
                actions.append(action)
            else:
                since[button] = state.kill_since[button]
    return since, tuple(actions)


def _step_switches(
    state: ButtonState, assignments: Assignments, positions: tuple[int, ...], now: float
) -> tuple[tuple[SwitchState, ...], tuple[Action, ...]]:
    switches: list[SwitchState] = []
    actions: list[Action] = []
    for switch, position, choices in zip(state.switches, positions, assignments.switches.values(), strict=True):
        if position != switch.candidate:
            switch = switch._replace(candidate=position, since=now)
        if switch.candidate != switch.position and now - switch.since >= DEBOUNCE_TIME:
            actions.append(choices[position])
            switch = switch._replace(position=position)
        switches.append(switch)
    return tuple(switches), tuple(actions)
