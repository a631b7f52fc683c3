"""What a free-running board's frames tell about the line: messages lost, frames late, its clock begun anew."""

from __future__ import annotations

from typing import NamedTuple

from avionics.link.framing import Frame

DRIFT = 1e-3
"""-; by which the board's clock may run slow or fast against ours: ten times what a crystal does"""
LATE = 0.02
"""s; behind the promptest frames from which one is late: four ticks"""


class FrameCounters(NamedTuple):
    """What came over the line since the start."""

    frames: int = 0
    """-; sensor frames"""
    lost: int = 0
    """-; messages missing in the sender's numbering"""
    late: int = 0
    """-; sensor frames more than `LATE` behind the promptest"""
    restarts: int = 0
    """-; times that the sensor time went back: the board restarted"""


class Arrivals:
    """Counts; knows nothing of what the frames mean but their number and time."""

    def __init__(self) -> None:
        self.counters = FrameCounters()
        self._sequence = -1
        self._missing = 0
        self._time_us = -1
        self._prompt = 0.0

    def message(self, frame: Frame) -> None:
        """One message came; MAVLink 2 numbers them in its fifth byte."""
        sequence = frame.raw[4]
        if self._sequence >= 0:
            self._missing += (sequence - self._sequence - 1) & 0xFF
        self._sequence = sequence

    def tick(self, time_us: int, now: float) -> None:
        """A sensor frame of the board's ``time_us`` was closed at ``now`` (s, our clock)."""
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
        """Offset of the clocks in s by the promptest frame; it creeps up, so that a slow clock is followed."""
        return min(behind, self._prompt + DRIFT * (time_us - self._time_us) * 1e-6)

    def resume(self) -> None:
        """The line was cut and is back: what was sent meanwhile is not counted as lost messages."""
        self._sequence = -1
        self._missing = 0
