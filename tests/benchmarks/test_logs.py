"""How fast logs are written and read, beside the `mcap` package's own reader (``make bench``)."""

from __future__ import annotations

import random
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from avionics import messages as m
from avionics import topics
from avionics.topics import Topic
from logs.layout import layout_of
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.scene import Pose, Scene, Shape
from sim_bridge import topics as truth_topics

MINUTES = 2.0
FIXED = tuple(t for t in topics.TOPICS + truth_topics.TOPICS if t.message not in (m.Event, m.Text) and t.rate)


def sample(topic: Topic, source: random.Random) -> list[Any]:
    """A pool of messages with noise in every floating-point field."""
    layout = layout_of(topic.message)
    return [
        topic.message(
            *(
                (1,) * f.length if f.length else source.gauss(0, 1) if f.scalar == "double" else 1
                for f in layout.fields
            )
        )
        for _ in range(200)
    ]


def flight() -> list[tuple[Topic, Any]]:
    source = random.Random(1)
    pools = {topic: sample(topic, source) for topic in FIXED}
    times = [(round(n * 1e6 / t.rate), t.channel, t) for t in FIXED for n in range(int(MINUTES * 60.0 * t.rate))]
    times.sort()
    return [(t, pools[t][n % 200]._replace(time_us=time_us)) for n, (time_us, _, t) in enumerate(times)]


def say(line: str) -> None:
    sys.stdout.write(line + "\n")


def timed(what: str, count: int, run: Callable[[], Any]) -> Any:
    start = time.perf_counter()
    out = run()
    elapsed = time.perf_counter() - start
    say(f"{what:34} {count / elapsed / 1e3:9.0f} k/s  {elapsed:6.2f} s")
    return out


@pytest.mark.bench
def test_messages_per_second(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    messages = flight()
    say(f"\n{len(messages)} messages on {len(FIXED)} topics")

    def write() -> None:
        with McapRecorder(path, start_epoch_ns=0) as recorder:
            for topic, message in messages:
                recorder.record(topic, message)
        assert not recorder.refusal and not recorder.failure

    timed("write", len(messages), write)
    say(f"{path.stat().st_size / 1e6:.1f} MB")
    tables = timed("read all topics", len(messages), lambda: open_log(path).tables())
    assert sum(len(table.time) for table in tables.values()) == len(messages)
    one = timed("read one topic", int(MINUTES * 60 * 200), lambda: open_log(path).columns(topics.IMU))
    assert len(one.time) == int(MINUTES * 60 * 200)
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(path.read_bytes()[:-10])
    timed("open a file without its end", len(messages), lambda: open_log(torn))
    timed("mcap package, decoded", len(messages) // 10, lambda: independent(path, len(messages) // 10))


def independent(path: Path, count: int) -> None:
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for number, _ in enumerate(reader.iter_decoded_messages(), 1):
            if number == count:
                return


@pytest.mark.bench
def test_frames_per_second() -> None:
    scene = Scene(Shape(0.5, 0.3, (0.1, 0.0, 0.0), 0.2, (-0.4, 0.0, 0.0), 0.3, 0.2, 0.1), 0)
    pose = Pose(5, (1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0), (0.1, 0.2), (0.1, 0.1), 0.1, 0.1)
    say("")
    size = timed("frame transforms", 5000, lambda: [scene.transforms(pose).ByteSize() for _ in range(5000)])
    assert len(set(size)) == 1
