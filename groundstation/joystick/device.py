"""Protocols of input devices: what they are, how they are found and how they are read."""

from __future__ import annotations

from typing import NamedTuple, Protocol


class DeviceInfo(NamedTuple):
    """Name and capabilities of a connected device."""

    name: str
    """-; as the system reports it"""
    guid: str
    """-; the same for every device of one model, 32 hexadecimal digits"""
    axes: int
    """-; number of axes"""
    buttons: int
    """-; number of buttons; each hat counts as four more: up, right, down, left"""


class Reading(NamedTuple):
    """State of a device at one time."""

    axes: tuple[float, ...]
    """-; raw values, -1 to 1"""
    pressed: frozenset[int] = frozenset()
    """-; numbers of the pressed buttons, from 0"""


class Device(Protocol):
    """An open device."""

    @property
    def info(self) -> DeviceInfo:
        """Name and capabilities."""

    def read(self) -> Reading | None:
        """Read the current state; None once the device is disconnected."""

    def close(self) -> None:
        """Release the device."""


class DeviceBackend(Protocol):
    """Access to the devices of this computer."""

    def devices(self) -> tuple[DeviceInfo, ...]:
        """List the connected devices."""

    def open(self, number: int) -> Device | None:
        """Open the device at this position of `devices`; None if it is disconnected meanwhile."""

    def close(self) -> None:
        """Release everything."""
