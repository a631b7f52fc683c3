"""Vibration in the web view: amplitude spectrum of the accelerometers from HIGHRES_IMU, while a browser wants it."""

from __future__ import annotations

import math
import threading
from collections import deque
from typing import Any

import numpy as np

from avionics.link.dialect import mavlink
from groundstation.link.commands import CommandExchange
from groundstation.link.connection import Connection
from groundstation.link.frames import Arrival

RATE = 100.0
"""Hz; requested rate of HIGHRES_IMU: 7 kB/s, the loop rate of the slowest autopilots"""
DEFAULT_INTERVAL = 0.0
"""us; interval of SET_MESSAGE_INTERVAL for the rate that the vehicle has by itself"""
LEASE = 10.0
"""s; without a browser that asks again, the messages are stopped"""
SAMPLES = 512
"""in the window of the spectrum, 5 s at `RATE`"""
FEWEST = 128
LONGEST_GAP = 0.5
"""s; a longer gap in the samples, or a step back of the vehicle's clock, starts the window again"""


class ImuSpectrum:
    """Window of the latest HIGHRES_IMU samples of the vehicle on a connection."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._lock = threading.Lock()
        self._samples: deque[tuple[float, float, float, float]] = deque(maxlen=SAMPLES)
        self._end = -math.inf
        self._requested = False
        connection.overhear(self._handle_frame)

    def want(self) -> None:
        """A browser shows the spectrum: have the messages sent for another `LEASE`."""
        self._end = self._connection.now() + LEASE

    def due(self) -> CommandExchange | None:
        """Return the SET_MESSAGE_INTERVAL that is due: for `RATE`, or for the vehicle's own rate at the end."""
        wanted = self._connection.now() < self._end
        if wanted == self._requested:
            return None
        self._requested = wanted
        with self._lock:
            self._samples.clear()
        parameters = (float(mavlink.MAVLINK_MSG_ID_HIGHRES_IMU), 1e6 / RATE if wanted else DEFAULT_INTERVAL)
        return CommandExchange(self._connection.target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, parameters)

    def _handle_frame(self, arrival: Arrival) -> None:
        message = arrival.message
        if not self._requested or message is None or message.get_type() != "HIGHRES_IMU":
            return
        if arrival.frame.system != self._connection.state.system:
            return
        sample = (1e-6 * message.time_usec, message.xacc, message.yacc, message.zacc)
        with self._lock:
            if self._samples and not 0.0 < sample[0] - self._samples[-1][0] < LONGEST_GAP:
                self._samples.clear()
            if all(map(math.isfinite, sample)):
                self._samples.append(sample)

    def document(self) -> dict[str, Any] | None:
        """Return ``rate`` and ``frequency`` in Hz, ``amplitude`` of ``x``, ``y``, ``z`` and their ``rms`` in m/s^2.

        Amplitudes of sine waves: a Hann window over at most `SAMPLES`, mean removed. None for fewer than `FEWEST`.
        """
        with self._lock:
            samples = np.array(self._samples)
        if len(samples) < FEWEST:
            return None
        time, values = samples[:, 0], samples[:, 1:]
        # Lost messages leave gaps: the transform needs even samples.
        even = np.linspace(time[0], time[-1], len(time))
        signals = np.column_stack([np.interp(even, time, column) for column in values.T])
        signals -= signals.mean(axis=0)
        window = np.hanning(len(signals))
        amplitude = 2.0 / window.sum() * np.abs(np.fft.rfft(window[:, None] * signals, axis=0))
        step = float(even[1] - even[0])
        return {
            "rate": 1.0 / step,
            "frequency": np.fft.rfftfreq(len(signals), step)[1:].round(2).tolist(),
            "amplitude": {axis: amplitude[1:, n].round(4).tolist() for n, axis in enumerate("xyz")},
            "rms": {axis: float(signals[:, n].std()) for n, axis in enumerate("xyz")},
        }
