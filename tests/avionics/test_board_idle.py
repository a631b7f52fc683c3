"""A board's line that brings anything but sensor frames: the ground links are served all the same."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from avionics.board import razor
from avionics.board.board import IDLE_EVERY, Board, BoardSilent, Surroundings
from avionics.board.hil import HilBoard
from avionics.board.razor import FrameClock, RazorBoard
from avionics.link.codec import FrameWriter
from avionics.link.sensor_codec import CODECS
from avionics.messages import EncoderSample

LOOK = 0.001
"""s; of the simulated clock that a read takes"""


class Babble:
    """A line that always has something to read, on its own clock."""

    name = "babble"
    plugged = True
    replugged = dropped = 0

    def __init__(self, reports: bytes = b"") -> None:
        self.now = 0.0
        self.idled: list[float] = []
        self.around = Surroundings(idle=lambda: self.idled.append(self.now))
        self._reports = reports
        self._random = random.Random(3)

    def read(self, timeout: float) -> bytes:
        self.now += LOOK
        return self._reports or self._random.randbytes(20)

    def write(self, data: bytes) -> bool:
        return True

    def close(self) -> None:
        pass

    def listen(self, board: Board) -> list[float]:
        """Times (s) at which the board called `idle` until it gave up."""
        with pytest.raises(BoardSilent):
            board.read()
        return [0.0, *self.idled, self.now]


def encoder_frame() -> bytes:
    encoder = CODECS["encoder"]
    return FrameWriter(1, 200).frame(encoder.message_id, encoder.encode(EncoderSample(1, 2, 3)))


@pytest.mark.parametrize("reports", [b"", encoder_frame()], ids=["noise", "messages that close no tick"])
def test_a_bridge_that_brings_no_sensor_frame_leaves_time_for_the_links(reports: bytes) -> None:
    line = Babble(reports)
    board = HilBoard("tcp:127.0.0.1:1", connect=lambda *_: line, clock=lambda: line.now, around=line.around)
    times = line.listen(board)
    assert max(b - a for a, b in pairwise(times)) < IDLE_EVERY + 2 * LOOK
    assert len(times) < 1.1 * line.now / IDLE_EVERY


def test_a_razor_that_brings_noise_leaves_time_for_the_links(monkeypatch: pytest.MonkeyPatch) -> None:
    line = Babble()
    monkeypatch.setattr(razor, "SerialLine", lambda device, baud: line)
    board = RazorBoard("razor:noise", clock=lambda: line.now, around=line.around)
    assert max(b - a for a, b in pairwise(line.listen(board))) < IDLE_EVERY + 2 * LOOK


def test_a_frame_after_a_gap_has_the_time_at_which_it_came_however_many_were_damaged_before_it() -> None:
    """GIVEN a regular line WHEN ten frames' time passes, in which one came damaged THEN the next is not early."""
    clock = FrameClock()
    for tick in range(100):
        before = clock.time_us(10.0 + 0.02 * tick)
    after = clock.time_us(10.0 + 0.02 * 110, skipped=1)
    assert after - before == pytest.approx(11 * 20_000, abs=1000)
