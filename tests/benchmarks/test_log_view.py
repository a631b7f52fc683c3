"""How long the page of an hour's flight takes, and how large it is (``make bench``)."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from circling import BUILDERS, messages, noisy
from test_logs import FIXED, sample

from avionics.topics import Topic
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.view.page import write_page

MINUTE_US = 60_000_000
LARGEST, LONGEST = 20e6, 20.0
"""bytes of the page, s"""


def minute() -> list[tuple[Topic, Any]]:
    """All that a flight records in a minute; what no page shows is the same message again and again."""
    source = random.Random(1)
    others = [topic for topic in FIXED if topic not in BUILDERS]
    unseen = {topic: sample(topic, source)[0] for topic in others}
    times = ((topic, round(n / topic.rate * 1e6)) for topic in others for n in range(1, int(60.0 * topic.rate) + 1))
    rest = [(topic, unseen[topic]._replace(time_us=time_us)) for topic, time_us in times]
    return sorted([*messages(60.0), *rest], key=lambda entry: (entry[1].time_us, entry[0].channel))


def hour() -> Iterator[tuple[Topic, Any]]:
    """Sixty times the same minute under other noise: nothing repeats that could be packed away."""
    source, once = random.Random(2), minute()
    for number in range(60):
        for topic, message in once:
            later = message._replace(time_us=message.time_us + number * MINUTE_US)
            yield topic, noisy(later, source) if topic in BUILDERS else later


@pytest.mark.bench
def test_an_hour_as_a_page(tmp_path: Path) -> None:
    count = 0
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=0) as recorder:
        for topic, message in hour():
            recorder.record(topic, message)
            count += 1
    assert not recorder.refusal and not recorder.failure
    size = recorder.path.stat().st_size
    start = time.perf_counter()
    with open_log(recorder.path) as log:
        page = write_page(log, tmp_path / "a.html")
    elapsed = time.perf_counter() - start
    sys.stdout.write(f"\nan hour as a page: {count} messages on {len(FIXED)} topics, {size / 1e6:.0f} MB: ")
    sys.stdout.write(f"{elapsed:.1f} s, {page.bytes / 1e6:.1f} MB\n")
    assert page.bytes < LARGEST and elapsed < LONGEST
