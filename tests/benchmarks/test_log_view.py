"""What an hour's flight holds, and its page: how long both take, and how large the page is (``make bench``)."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from circling import BUILDERS, messages, noisy
from mcap.reader import make_reader
from rows import Row, leave, peer
from test_logs import FIXED, quickest, sample, send, timed

from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.view.page import write_page
from wingbeat.topic import Topic

MINUTE_US = 60_000_000
LARGEST, LONGEST = 20e6, 20.0
"""bytes of the page, s"""
LONGEST_INFO = 2.0
"""s"""


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


class Recorded(NamedTuple):
    path: Path
    messages: int


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """The file of an hour's flight."""
    count = 0
    with McapRecorder(tmp_path_factory.mktemp("hour") / "a.mcap", start_epoch_ns=0) as recorder:
        for topic, message in hour():
            recorder.record(topic, message)
            count += 1
    assert not recorder.refusal and not recorder.failure
    size = recorder.path.stat().st_size
    send(f"\nan hour's flight: {count} messages on {len(FIXED)} topics, {size / 1e6:.0f} MB")
    return Recorded(recorder.path, count)


@pytest.mark.bench
def test_what_an_hour_holds(recorded: Recorded) -> None:
    """GIVEN the command as a user starts it WHEN it tells what an hour's flight holds THEN nobody waits for it."""
    elapsed, done = quickest(lambda: info(recorded.path), 3)
    send(f"\nwingbeat log info of it: {elapsed:.2f} s")
    plain, counts = quickest(lambda: summary_by_mcap(recorded.path), 1)
    send(f"the mcap package reads its summary, without rates and gaps, in {plain:.2f} s")
    requested = f"at most {LONGEST_INFO:g}"
    leave(Row("wingbeat log info of an hour's flight", elapsed, plain, "s", peer("mcap"), requested))
    told = json.loads(done)
    assert told["messages"] == recorded.messages == sum(counts.values())
    assert all(row["rate"] == pytest.approx(row["nominal_rate"], rel=0.01) for row in told["topics"])
    assert elapsed < LONGEST_INFO


def info(path: Path) -> str:
    command = [sys.executable, "-m", "groundstation.command.main", "log", "info", "--json", str(path)]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=120).stdout


def summary_by_mcap(path: Path) -> dict[int, int]:
    """Messages of every channel."""
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None and summary.statistics is not None
    return summary.statistics.channel_message_counts


@pytest.mark.bench
def test_an_hour_as_a_page(recorded: Recorded, tmp_path: Path) -> None:
    with open_log(recorded.path) as log:
        elapsed, page = timed(lambda: write_page(log, tmp_path / "a.html"))
    send(f"\nits page: {elapsed:.1f} s, {page.bytes / 1e6:.1f} MB")
    leave(Row("an hour's flight as a page", elapsed, None, "s", requested=f"at most {LONGEST:g}"))
    assert page.bytes < LARGEST and elapsed < LONGEST
