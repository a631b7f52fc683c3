"""Random messages of every topic, and small recordings made of them."""

from __future__ import annotations

import random
import struct
from functools import cache
from pathlib import Path
from typing import Any

from avionics import topics
from logs.layout import Field, layout_of
from logs.recorder import McapRecorder
from sim_bridge import topics as truth_topics
from wingbeat.message import Event, Severity, Text
from wingbeat.topic import Topic

EPOCH_NS = 1_700_000_000_000_000_000
ALL_TOPICS = topics.TOPICS + truth_topics.TOPICS
FIXED_TOPICS = tuple(topic for topic in ALL_TOPICS if topic.message not in (Event, Text))
LIMITS = {
    "fixed32": (0, 2**32 - 1),
    "sfixed32": (-(2**31), 2**31 - 1),
    "fixed64": (0, 2**63 - 1),
    "sfixed64": (-(2**63), 2**63 - 1),
}


def random_value(field: Field, source: random.Random) -> Any:
    if field.length:
        return tuple(random_value(field._replace(length=0), source) for _ in range(field.length))
    if field.scalar in LIMITS:
        return source.randint(*LIMITS[field.scalar])
    return struct.unpack("<d", struct.pack("<d", source.gauss(0.0, 1e3)))[0]


def random_message(topic: Topic, time_us: int, source: random.Random) -> Any:
    if topic.message is Event:
        return Event(time_us, Severity(source.randrange(8)), "guidance", f"event {source.random()}")
    if topic.message is Text:
        return Text(time_us, f'{{"value": {source.random()}}}')
    values = [random_value(field, source) for field in layout_of(topic.message).fields]
    return topic.message(*values)._replace(time_us=time_us)


def flight(duration: float = 2.0, chosen: tuple[Topic, ...] = ALL_TOPICS, seed: int = 1) -> list[tuple[Topic, Any]]:
    """Messages of ``duration`` seconds in the order of their times; events come once a second."""
    return list(_messages(duration, chosen, seed))


@cache
def _messages(duration: float, chosen: tuple[Topic, ...], seed: int) -> tuple[tuple[Topic, Any], ...]:
    source = random.Random(seed)
    times = [
        (round(min(n / (topic.rate or 1.0), duration) * 1e6), topic)
        for topic in chosen
        for n in range(1, max(1, int(duration * (topic.rate or 1.0))) + 1)
    ]
    return tuple(
        (topic, random_message(topic, time, source))
        for time, topic in sorted(times, key=lambda t: (t[0], t[1].channel))
    )


def record(path: Path, messages: list[tuple[Topic, Any]], **options: Any) -> Path:
    """Record messages, a vehicle file and a note; the wall clock stands still."""
    options = {"start_epoch_ns": EPOCH_NS, "clock": lambda: 0.0} | options
    with McapRecorder(path, **options) as recorder:
        recorder.note("flight", {"vehicle": "robo_raven_ii_d", "seed": "7"})
        recorder.attach("vehicle.toml", "application/toml", b"name = 'raven'\n")
        for topic, message in messages:
            recorder.record(topic, message)
        assert not recorder.failure and not recorder.refusal
    return path
