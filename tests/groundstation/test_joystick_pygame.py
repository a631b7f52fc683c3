"""Devices through pygame-ce, with virtual joysticks of SDL: no hardware, no window."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from groundstation.joystick import pygame_device
from groundstation.joystick.device import Reading
from groundstation.joystick.pygame_device import PygameBackend

pytest.importorskip("pygame", reason="pygame-ce is not installed: pip install pygame-ce")
if not sys.platform.startswith("linux"):
    pytest.skip("the SDL library of pygame is found in /proc", allow_module_level=True)

FLIGHT_STICK = 4
"""-; SDL_JOYSTICK_TYPE_FLIGHT_STICK"""
UP = 1
"""-; SDL_HAT_UP"""


class VirtualJoystick:
    """A virtual joystick of SDL with 4 axes, 3 buttons and a hat."""

    def __init__(self, sdl: Any) -> None:
        self._sdl = sdl
        self._index = sdl.SDL_JoystickAttachVirtual(FLIGHT_STICK, 4, 3, 1)
        assert self._index >= 0
        self._handle = sdl.SDL_JoystickOpen(self._index)

    def set_axis(self, number: int, value: int) -> None:
        assert self._sdl.SDL_JoystickSetVirtualAxis(self._handle, number, value) == 0

    def set_button(self, number: int, value: int) -> None:
        assert self._sdl.SDL_JoystickSetVirtualButton(self._handle, number, value) == 0

    def set_hat(self, value: int) -> None:
        assert self._sdl.SDL_JoystickSetVirtualHat(self._handle, 0, value) == 0

    def detach(self) -> None:
        assert self._sdl.SDL_JoystickDetachVirtual(self._index) == 0


@pytest.fixture
def backend(monkeypatch: pytest.MonkeyPatch) -> Iterator[PygameBackend]:
    for name, value in pygame_device._ENVIRONMENT.items():
        monkeypatch.setenv(name, value)
    backend = PygameBackend()
    yield backend
    backend.close()


@pytest.fixture
def sdl(backend: PygameBackend) -> Any:
    """The SDL library that pygame has loaded."""
    maps = Path("/proc/self/maps").read_text().splitlines()
    path = next((line.split(maxsplit=5)[5] for line in maps if "libSDL2-" in line), None)
    if path is None:
        pytest.skip("pygame has no SDL library of its own")
    library = ctypes.CDLL(path)
    if not hasattr(library, "SDL_JoystickAttachVirtual"):
        pytest.skip("this SDL has no virtual joysticks")
    handle, number = ctypes.c_void_p, ctypes.c_int
    library.SDL_JoystickOpen.restype = handle
    library.SDL_JoystickSetVirtualAxis.argtypes = [handle, number, ctypes.c_int16]
    library.SDL_JoystickSetVirtualButton.argtypes = [handle, number, ctypes.c_uint8]
    library.SDL_JoystickSetVirtualHat.argtypes = [handle, number, ctypes.c_uint8]
    return library


def test_device_is_listed_and_read(backend: PygameBackend, sdl: Any) -> None:
    assert backend.devices() == ()
    virtual = VirtualJoystick(sdl)
    (info,) = backend.devices()
    assert info.name and len(info.guid) == 32 and (info.axes, info.buttons) == (4, 3 + 4)
    device = backend.open(0)
    assert device is not None and device.info == info
    assert device.read() == Reading((0.0,) * 4)
    virtual.set_axis(0, -32768)
    virtual.set_axis(2, 16384)
    virtual.set_button(1, 1)
    virtual.set_hat(UP)
    assert device.read() == Reading((-1.0, 0.0, 0.5, 0.0), frozenset((1, 3)))
    device.close()
    virtual.detach()


def test_device_that_is_removed_is_never_read_as_centered(backend: PygameBackend, sdl: Any) -> None:
    """SDL sets the axes of a removed device to 0: half throttle of a stick with full travel."""
    virtual = VirtualJoystick(sdl)
    device = backend.open(0)
    assert device is not None
    virtual.set_axis(2, -32768)
    reading = device.read()
    assert reading is not None and reading.axes[2] == -1.0
    virtual.detach()
    assert device.read() is None and device.read() is None
    device.close()
    assert backend.devices() == () and backend.open(0) is None


def test_device_is_opened_again_after_it_returns(backend: PygameBackend, sdl: Any) -> None:
    virtual = VirtualJoystick(sdl)
    (info,) = backend.devices()
    device = backend.open(0)
    assert device is not None
    virtual.detach()
    assert device.read() is None
    device.close()
    virtual = VirtualJoystick(sdl)
    assert backend.devices() == (info,)
    device = backend.open(0)
    assert device is not None
    virtual.set_axis(0, -32768)
    reading = device.read()
    assert reading is not None and reading.axes[0] == -1.0
    device.close()
    virtual.detach()
