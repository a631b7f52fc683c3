"""Input devices through pygame-ce (SDL): Linux, macOS and Windows."""

from __future__ import annotations

import os
from typing import Any

from groundstation.joystick.device import Device, DeviceInfo, Reading
from logs.extras import load_extra

PACKAGE = "pygame-ce"
_ENVIRONMENT = {
    # Without a window SDL has no focus, so background events are enabled.
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
    "SDL_VIDEODRIVER": "dummy",
    # Otherwise SDL would convert Ctrl-C and SIGTERM to events.
    "SDL_NO_SIGNAL_HANDLERS": "1",
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
}
_HAT_BUTTONS = 4


class PygameBackend:
    """Access to the devices of SDL; a `DeviceBackend`."""

    def __init__(self) -> None:
        """Start SDL's joystick subsystem, without a window.

        Raises:
            InputError: pygame-ce is not installed; the message has the command that installs it.
        """
        for name, value in _ENVIRONMENT.items():
            os.environ.setdefault(name, value)
        self._pygame = load_extra("pygame", PACKAGE, "the joystick")
        # The event queue of SDL belongs to its video subsystem.
        self._pygame.display.init()
        self._pygame.joystick.init()

    def devices(self) -> tuple[DeviceInfo, ...]:
        """List the connected devices."""
        self._pygame.event.pump()
        found = (self._open(number) for number in range(self._pygame.joystick.get_count()))
        return tuple(_info(joystick) for joystick in found if joystick is not None)

    def open(self, number: int) -> Device | None:
        """Open the device at this position of `devices`; None if it is disconnected meanwhile."""
        joystick = self._open(number)
        return None if joystick is None else PygameDevice(self._pygame, joystick)

    def _open(self, number: int) -> Any | None:
        try:
            return self._pygame.joystick.Joystick(number)
        except self._pygame.error:
            return None

    def close(self) -> None:
        """Stop SDL."""
        self._pygame.joystick.quit()
        self._pygame.display.quit()


class PygameDevice:
    """An open device; a `Device`."""

    def __init__(self, pygame: Any, joystick: Any) -> None:
        self.info = _info(joystick)
        self._pygame = pygame
        self._joystick = joystick
        self._instance = joystick.get_instance_id()
        self._connected = True

    def read(self) -> Reading | None:
        """Read the current state; None once the device is disconnected.

        SDL sets every axis to 0 when a device is removed, which would be half throttle: the events are handled
        before the axes are read.
        """
        for event in self._pygame.event.get():
            if event.type == self._pygame.JOYDEVICEREMOVED and event.instance_id == self._instance:
                self._connected = False
        if not self._connected:
            return None
        joystick = self._joystick
        axes = tuple(joystick.get_axis(number) for number in range(self.info.axes))
        buttons = [bool(joystick.get_button(number)) for number in range(joystick.get_numbuttons())]
        for hat in range(joystick.get_numhats()):
            right, up = joystick.get_hat(hat)
            buttons += [up > 0, right > 0, up < 0, right < 0]
        return Reading(axes, frozenset(number for number, pressed in enumerate(buttons) if pressed))

    def close(self) -> None:
        """Release the device."""
        self._joystick.quit()


def _info(joystick: Any) -> DeviceInfo:
    buttons = joystick.get_numbuttons() + _HAT_BUTTONS * joystick.get_numhats()
    return DeviceInfo(joystick.get_name(), joystick.get_guid(), joystick.get_numaxes(), buttons)
