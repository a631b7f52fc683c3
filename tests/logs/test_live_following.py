"""A recording that is read while it grows: whole messages, each once, evenly; what is too much is counted."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.reader import make_reader
from recorded import EPOCH_NS, flight, record

from avionics import topics
from logs.live import follower as following
from logs.live.follower import Follower, Message
from logs.live.playout import DELAY, Playout
from logs.recorder import McapRecorder
from logs.records import Damage
from sim_bridge import topics as truth_topics

SHOWN = (topics.ATTITUDE, topics.EVENTS, truth_topics.STATE)


def written(path: Path) -> list[Message]:
    """What the package's own reader finds."""
    with path.open("rb") as file:
        return [Message(m.log_time, c.id, m.data) for _, c, m in make_reader(file).iter_messages()]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record(tmp_path_factory.mktemp("live") / "whole.mcap", flight(3.0, SHOWN))


@pytest.mark.parametrize("step", [3, 1000, 10**9])
def test_however_the_bytes_come_every_message_is_read_once(whole: Path, tmp_path: Path, step: int) -> None:
    data = whole.read_bytes()
    data = data[:60_000] if step < 1000 else data
    path = tmp_path / "growing.mcap"
    follower, found = Follower(path), list[Message]()
    assert follower.read() == []
    with path.open("wb", buffering=0) as file:
        for offset in range(0, len(data), step):
            file.write(data[offset : offset + step])
            found += follower.read()
    expected = written(whole)
    assert found and found == (expected if step >= 1000 else expected[: len(found)])
    assert follower.finished == (step >= 1000) and follower.skipped == 0
    assert follower.end_ns == max(message.log_ns for message in found)
    assert set(follower.channels) >= {message.channel for message in found}
    assert all(channel.schema_id in follower.schemas for channel in follower.channels.values())
    follower.close()


def test_what_a_recorder_has_flushed_is_there(tmp_path: Path) -> None:
    path = tmp_path / "flown.mcap"
    follower = Follower(path)
    with McapRecorder(path, start_epoch_ns=EPOCH_NS, clock=lambda: 0.0) as recorder:
        for topic, message in flight(1.0, SHOWN):
            recorder.record(topic, message)
            follower.read()
            # The recorder keeps a quarter of a second to itself, and nothing else is late.
            assert EPOCH_NS + message.time_us * 1000 - max(follower.end_ns, EPOCH_NS) <= 255_000_000
        assert not follower.finished
    follower.read()
    assert follower.finished


def test_only_what_is_wanted_is_given_and_nothing_else_counts_as_left_out(whole: Path) -> None:
    one = Follower(whole).read(lambda channel: channel == topics.ATTITUDE.channel)
    assert one == [message for message in written(whole) if message.channel == topics.ATTITUDE.channel]
    nobody = Follower(whole)
    assert nobody.read(lambda channel: False) == [] and nobody.skipped == 0 and nobody.finished


def test_of_too_much_the_newest_is_given_and_the_rest_is_counted(
    whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(following, "AT_ONCE", 40_000)
    follower, everything = Follower(whole), written(whole)
    newest = follower.read()
    assert 0 < len(newest) < len(everything) and newest == everything[-len(newest) :]
    assert follower.skipped == len(everything) - len(newest)


def test_a_damaged_chunk_is_counted_and_what_is_no_recording_is_refused(whole: Path, tmp_path: Path) -> None:
    data = bytearray(whole.read_bytes())
    data[data.index(b"\x04\x00\x00\x00zstd") + 100] ^= 0xFF
    (tmp_path / "bent.mcap").write_bytes(data)
    follower = Follower(tmp_path / "bent.mcap")
    found = follower.read()
    assert 0 < follower.skipped < len(written(whole)) == follower.skipped + len(found)
    (tmp_path / "no.mcap").write_bytes(b"P6 640 480")
    with pytest.raises(Damage, match="not an MCAP log"):
        Follower(tmp_path / "no.mcap").read()


def bursts(speed: float, seconds: float) -> list[tuple[float, int]]:
    """(wall-clock time, messages given out) where 50 messages a second come in bursts of a quarter of a second."""
    playout, shown, sent, step = Playout(), [], 0, 0.02
    for tick in range(int(seconds / step)):
        wall = tick * step
        flown = int(wall * speed / 0.25) * 12
        playout.add(Message((n + 1) * 20_000_000, 1, b"") for n in range(sent, flown))
        sent = flown
        shown.append((wall, len(playout.step(sent * 20_000_000, step))))
    return shown


@pytest.mark.parametrize("speed", [0.5, 1.0, 8.0])
def test_what_comes_in_bursts_is_shown_at_an_even_pace(speed: float) -> None:
    counts = [count for wall, count in bursts(speed, 8.0) if wall > 3.0]
    mean = 12 / 0.25 * speed * 0.02
    assert sum(counts) / len(counts) == pytest.approx(mean, rel=0.05)
    # A burst would be twelve at once, and none in between.
    assert max(counts) <= max(2, 2.0 * mean) and counts.count(0) < 0.75 * len(counts)


def test_two_files_are_given_out_in_the_order_of_time_and_the_late_at_once() -> None:
    playout = Playout()
    playout.add([Message(10, 1, b""), Message(30, 1, b"")])
    playout.add([Message(20, 2, b"")])
    assert [message.log_ns for message in playout.step(30, 0.0)] == [10]
    assert [message.log_ns for message in playout.step(30, DELAY)] == [20, 30] and playout.now_ns == 30
    playout.add([Message(25, 2, b"")])
    assert [message.log_ns for message in playout.step(30, 0.01)] == [25] and playout.now_ns == 30
    playout.add([Message(90, 2, b""), Message(80, 1, b"")])
    assert [message.log_ns for message in playout.rest()] == [80, 90] and playout.now_ns == 90
