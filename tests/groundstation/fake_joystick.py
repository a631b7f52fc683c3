"""Input devices of the tests: a backend whose devices are moved by the test."""

from __future__ import annotations

from groundstation.joystick.axes import Axis
from groundstation.joystick.device import Device, DeviceInfo, Reading
from groundstation.joystick.settings import Settings

RADIO = DeviceInfo("OpenTX Radiomaster TX16S Joystick", "030000000912000042524f5400000000", 8, 24)
CENTERED = (0.0, 0.0, -1.0, 0.0, -1.0, -1.0, -1.0, -1.0)
"""roll, pitch, throttle, yaw and switches of a transmitter whose sticks are centered, throttle at its lower end"""
SETTINGS = Settings(RADIO.name, RADIO.guid, roll=Axis(0), pitch=Axis(1), yaw=Axis(3), throttle=Axis(2))


class FakeDevice:
    """A device that reads what the test sets; a `Device`."""

    def __init__(self, info: DeviceInfo = RADIO, axes: tuple[float, ...] = CENTERED) -> None:
        self.info = info
        self.axes = list(axes)
        self.pressed: set[int] = set()
        self.connected = True

    def read(self) -> Reading | None:
        return Reading(tuple(self.axes), frozenset(self.pressed)) if self.connected else None

    def close(self) -> None:
        pass


class FakeBackend:
    """A computer with these devices; a `DeviceBackend`."""

    def __init__(self, *devices: FakeDevice) -> None:
        self.connected = list(devices)
        self.closed = False

    def devices(self) -> tuple[DeviceInfo, ...]:
        return tuple(device.info for device in self.connected if device.connected)

    def open(self, number: int) -> Device | None:
        return [device for device in self.connected if device.connected][number]

    def close(self) -> None:
        self.closed = True
