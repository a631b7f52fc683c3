"""Serial device that may be disconnected and reconnected; all waits are bounded."""

from __future__ import annotations

import contextlib
import errno
import os
import select
import time
from collections.abc import Callable
from typing import Any

import serial

from wingbeat.errors import InputError

_CHUNK = 65536
_FAILURES: tuple[type[Exception], ...] = (OSError, ValueError)
"""exceptions of pyserial when a device disconnects"""
with contextlib.suppress(ImportError):
    import termios

    _FAILURES += (termios.error,)
_READ_FAILURES: tuple[type[Exception], ...] = (*_FAILURES, TypeError)


class SerialLine:
    """Byte stream of a serial device; implements `avionics.link.transport.Stream`.

    `read` does not report a disconnection: a device is opened again as soon as it is reconnected.
    """

    def __init__(self, device: str, baud: int, sleep: Callable[[float], None] = time.sleep) -> None:
        """Open the device.

        Raises:
            InputError: it is missing, in use, or does not support this baud rate.
        """
        self.name = f"serial:{device},{baud}"
        self.dropped = 0
        """incomplete writes"""
        self.replugged = 0
        """reconnections of the device"""
        self._device, self._baud = device, baud
        self._sleep = sleep
        try:
            self._port: Any = self._opened()
        except _FAILURES as error:
            raise InputError(f"cannot open serial device {device} at {baud} baud: {_reason(error)}") from None

    @property
    def plugged(self) -> bool:
        """True if the device is connected."""
        return self._port is not None

    def read(self, timeout: float, most: int = _CHUNK) -> bytes:
        """Return at most ``most`` bytes as soon as some are available.

        The result is empty after ``timeout`` (s) or while disconnected.
        """
        if self._port is None and not self._reopened():
            self._sleep(timeout)
            return b""
        try:
            if self._port.timeout != timeout:
                self._port.timeout = timeout
            first = bytes(self._port.read(1))
            return first + bytes(self._port.read(min(self._port.in_waiting, most - 1))) if first else b""
        except _READ_FAILURES:
            self._close()
            return b""

    def write(self, data: bytes) -> bool:
        """Write without waiting; False if disconnected or incomplete."""
        sent = self._port is not None and self._sent(data)
        self.dropped += not sent
        return sent

    def _sent(self, data: bytes) -> bool:
        try:
            return self._has_tx_space() and bool(self._port.write(data) == len(data))
        except serial.SerialTimeoutException:
            return False
        except _FAILURES:
            self._close()
            return False

    def _has_tx_space(self) -> bool:
        """Return whether a write would not block.

        On POSIX pyserial spins on a full buffer.
        """
        return os.name != "posix" or bool(select.select([], [self._port.fileno()], [], 0.0)[1])

    def close(self) -> None:
        """Close the device."""
        if self._port is not None:
            self._close()

    def _opened(self) -> Any:
        exclusive = True if os.name == "posix" else None
        return serial.Serial(self._device, self._baud, timeout=0, write_timeout=0, exclusive=exclusive)

    def _reopened(self) -> bool:
        with contextlib.suppress(*_FAILURES):
            self._port = self._opened()
            self.replugged += 1
            return True
        return False

    def _close(self) -> None:
        with contextlib.suppress(*_FAILURES):
            self._port.close()
        self._port = None


def _reason(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.EAGAIN, errno.EBUSY):
        return "another program has it"
    return os.strerror(number) if isinstance(number, int) else str(error)
