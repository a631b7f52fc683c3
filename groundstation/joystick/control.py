"""Manual control: sticks at a fixed rate, button actions, device loss."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import NamedTuple

from groundstation.joystick import actions
from groundstation.joystick.actions import Action, ActionKind, ButtonState
from groundstation.joystick.device import Device, DeviceBackend, Reading
from groundstation.joystick.settings import Settings
from groundstation.joystick.sticks import Sticks, manual_control
from groundstation.link import modes, orders
from groundstation.link.exchange import Exchange
from groundstation.link.station import Station
from wingbeat.errors import InputError

DEFAULT_RATE = 25.0
"""Hz; of MANUAL_CONTROL, as QGroundControl's"""
RECONNECT_PERIOD = 0.5
"""s; between two searches for a device that was disconnected"""
ARMING_THROTTLE = 0.05
"""-; throttle above which arming is denied"""


class DeviceState(StrEnum):
    """State of the input device."""

    ACTIVE = "active"
    """sticks are sent"""
    WAITING = "waiting"
    """connected, the position of the throttle is not known yet"""
    DISCONNECTED = "disconnected"
    """nothing is sent"""


class ControlStatus(NamedTuple):
    """What is sent, for views."""

    device: str
    """-; name"""
    state: DeviceState
    sticks: Sticks | None
    """None while nothing is sent"""
    sent: int
    """-; number of MANUAL_CONTROL messages"""


class ManualControl:
    """Polls the device and the station; call `poll` at a multiple of the rate."""

    def __init__(
        self, station: Station, backend: DeviceBackend, device: Device, settings: Settings, rate: float = DEFAULT_RATE
    ) -> None:
        """Nothing is sent before the first `poll`; ``rate`` (Hz) is that of MANUAL_CONTROL."""
        self.station = station
        self._backend = backend
        self._info = device.info
        self._device: Device | None = device
        self._settings = settings
        self._period = 1.0 / rate
        self._due = float("-inf")
        self._search_at = float("-inf")
        self._is_reported = False
        self._buttons: ButtonState | None = None
        self._sticks: Sticks | None = None
        self._sent = 0

    @property
    def status(self) -> ControlStatus:
        """What is sent now."""
        if self._device is None:
            state = DeviceState.DISCONNECTED
        else:
            state = DeviceState.ACTIVE if self._is_reported else DeviceState.WAITING
        return ControlStatus(self._info.name, state, self._sticks, self._sent)

    def poll(self) -> bool:
        """Receive what has arrived, then send the sticks if they are due; return whether anything was received."""
        received = self.station.poll()
        now = self.station.connection.now()
        reading = self._read(now)
        if reading is None:
            self._sticks = None
            return received
        self._sticks = self._settings.sticks(reading)
        self._buttons, triggered = actions.step(self._buttons, self._settings.assignments, reading, now)
        for action in triggered:
            self._order(action)
        if now >= self._due:
            # A late message must not advance the next ones.
            self._due = max(self._due + self._period, now)
            self.station.connection.send(manual_control(self.station.connection.target.system, self._sticks))
            self._sent += 1
        return received

    def _read(self, now: float) -> Reading | None:
        """Return the state of a device that is connected and has reported its throttle.

        Some systems report 0 for an axis until it moves, which would be half throttle of a stick with full travel.
        """
        if self._device is None and not self._reconnect(now):
            return None
        assert self._device is not None
        reading = self._device.read()
        if reading is None:
            self._disconnect(self._device, now)
            return None
        throttle = reading.axes[self._settings.throttle.axis]
        self._is_reported = self._is_reported or self._settings.throttle_upper_half or throttle != 0.0
        return reading if self._is_reported else None

    def _disconnect(self, device: Device, now: float) -> None:
        device.close()
        self._device, self._buttons, self._is_reported = None, None, False
        self._search_at = now + RECONNECT_PERIOD
        self.station.note(f"joystick {self._info.name} disconnected: no sticks are sent", failed=True)

    def _reconnect(self, now: float) -> bool:
        if now < self._search_at:
            return False
        self._search_at = now + RECONNECT_PERIOD
        for number, info in enumerate(self._backend.devices()):
            if info == self._info:
                self._device = self._backend.open(number)
                break
        if self._device is not None:
            self.station.note(f"joystick {self._info.name} reconnected")
        return self._device is not None

    def _order(self, action: Action) -> None:
        connection = self.station.connection
        if action.kind is ActionKind.NONE:
            return
        if connection.state.system is None:
            self.station.note(f"{action.text()}: no vehicle on the link", failed=True)
            return
        if action.kind is ActionKind.ARM and self._sticks is not None and self._sticks.throttle > ARMING_THROTTLE:
            self.station.note("not armed: the throttle is not at zero", failed=True)
            return
        try:
            exchange = _EXCHANGES[action.kind](self.station, action)
        except InputError as error:
            self.station.note(str(error), failed=True)
            return
        self.station.command(action.text(), exchange, _DONE.get(action.kind, action.text()))


def _change_mode(station: Station, action: Action) -> Exchange:
    connection = station.connection
    return orders.change_to(connection, modes.equivalent(connection.state, action.mode))


_EXCHANGES: dict[ActionKind, Callable[[Station, Action], Exchange]] = {
    ActionKind.ARM: lambda station, action: orders.arm(station.connection.target),
    ActionKind.DISARM: lambda station, action: orders.disarm(station.connection.target),
    ActionKind.KILL: lambda station, action: orders.kill(station.connection.target),
    ActionKind.RETURN: lambda station, action: orders.return_home(station.connection),
    ActionKind.LAND: lambda station, action: orders.land(station.connection),
    ActionKind.MODE: _change_mode,
}
_DONE = {
    ActionKind.ARM: "armed",
    ActionKind.DISARM: "disarmed",
    ActionKind.KILL: "killed",
    ActionKind.RETURN: "returning",
    ActionKind.LAND: "landing",
}
