"""Records until it is killed, as a flight does, and says on a pipe what it has recorded and when.

``python recording_child.py PATH RATE SPEED``: RATE in Hz of one topic, or ``all`` for a whole flight; SPEED in flight
time per wall time, ``inf`` for as fast as it goes.
"""

from __future__ import annotations

import math
import os
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from recorded import EPOCH_NS, FIXED_TOPICS, flight

from avionics import messages as m
from avionics import topics
from logs.recorder import IN_FLIGHT, McapRecorder, Writing
from wingbeat.topic import Topic

RECORDED = tuple(topic for topic in FIXED_TOPICS if topic is not topics.RECORDER)
"""all but what the recorder says itself"""
TOLD = struct.Struct("<Hqd")
"""of one message: channel, time in us since boot, wall clock in s when it had been recorded"""


def one_topic(rate: float) -> Iterator[tuple[Topic, Any]]:
    number = 0
    while True:
        yield topics.HEALTH, m.Health(round(number / rate * 1e6), 0, 0, number % 2**32)
        number += 1


def whole_flight() -> Iterator[tuple[Topic, Any]]:
    """A second of a flight again and again."""
    second, begin = flight(1.0, RECORDED), 0
    while True:
        for topic, message in second:
            yield topic, message._replace(time_us=begin + message.time_us)
        begin += 1_000_000


def record_until_killed(path: Path, messages: Iterator[tuple[Topic, Any]], speed: float) -> None:
    """Every message is recorded when its time has come."""
    writing = Writing(IN_FLIGHT, account=topics.RECORDER)
    recorder = McapRecorder(path, start_epoch_ns=EPOCH_NS, topics=RECORDED, writing=writing)
    began = time.monotonic()
    for topic, message in messages:
        if not math.isinf(speed):
            time.sleep(max(began + message.time_us * 1e-6 / speed - time.monotonic(), 0.0))
        recorder.record(topic, message)
        os.write(sys.stdout.fileno(), TOLD.pack(topic.channel, message.time_us, time.monotonic()))


if __name__ == "__main__":
    place, rate, pace = sys.argv[1:]
    record_until_killed(Path(place), whole_flight() if rate == "all" else one_topic(float(rate)), float(pace))
