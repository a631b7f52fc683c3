"""Line statistics of a free-running board: lost messages, late frames, restarts."""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.framing import Frame

DRIFT = 1e-3
"""-; maximum relative rate error of the board's clock: ten times that of a crystal"""
LATE = 0.02
"""s; delay relative to the fastest frames above which a frame is late: four ticks"""


class FrameCounters(NamedTuple):
    """Counters of the line since the start."""

    frames: int = 0
    """-; sensor frames"""
    lost: int = 0
    """-; gaps in the sequence numbers of the sender"""
    late: int = 0
    """-; sensor frames delayed by more than `LATE`"""
    restarts: int = 0
    """-; decreases of the sensor time: the board restarted"""


class Arrivals:
    """Counter of frames and losses, by sequence number and time only."""

    def __init__(self) -> None:
        self.counters = FrameCounters()
        self._sequence = -1
        self._missing = 0
        self._time_us = -1
        self._prompt = 0.0

    def message(self, frame: Frame) -> None:
        """Count one message; its sequence number is in the fifth byte of MAVLink 2."""
        sequence = frame.raw[4]
        if self._sequence >= 0:
            self._missing += (sequence - self._sequence - 1) & 0xFF
        self._sequence = sequence

    def tick(self, time_us: int, now: float) -> None:
        """Count a sensor frame with the board time ``time_us``.

        ``now`` (s) is the local time of its completion.
        """
        frames, lost, late, restarts = self.counters
        behind = now - time_us * 1e-6
        if time_us <= self._time_us:
            restarts += 1  # its numbering began anew too, so the gap in it says nothing
            self._prompt = behind
        else:
            lost += self._missing
            self._prompt = behind if self._time_us < 0 else self._promptest(time_us, behind)
        late += behind - self._prompt > LATE
        self._missing, self._time_us = 0, time_us
        self.counters = FrameCounters(frames + 1, lost, late, restarts)

    def _promptest(self, time_us: int, behind: float) -> float:
        """Return the clock offset (s) of the fastest frames, with drift for a slow clock."""
        return min(behind, self._prompt + DRIFT * (time_us - self._time_us) * 1e-6)

    def resume(self) -> None:
        """Resume after a disconnection, without counting its messages as lost."""
        self._sequence = -1
        self._missing = 0
