"""What goes by on a link: losses by sequence numbers, rates, latency."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from avionics.link.dialect import mavlink
from groundstation.link.frames import Arrival, GroundReader, read
from groundstation.link.latency import Latency
from groundstation.link.traffic import WINDOW, Traffic


def frames_of(count: int, start: int = 0) -> list[Any]:
    """ATTITUDE frames of system 1 with rising sequence numbers."""
    packer = mavlink.MAVLink(None, 1, 1)
    data = b""
    for n in range(count):
        packer.seq = (start + n) % 256
        data += mavlink.MAVLink_attitude_message(20 * n, 0.1 * n, 0, 0, 0, 0, 0).pack(packer)
    return GroundReader().feed(data)


def received(frames: list[Any], period: float = 0.02, decoded: bool = False) -> tuple[Traffic, float]:
    traffic = Traffic()
    for number, frame in enumerate(frames):
        traffic.handle_frame(Arrival(frame, read(frame) if decoded else None, number * period))
    return traffic, (len(frames) - 1) * period


@given(st.integers(0, 255), st.sets(st.integers(1, 298), max_size=100))
@settings(max_examples=40, deadline=None)
def test_what_is_missing_from_the_count_is_lost(start: int, dropped: set[int]) -> None:
    frames = [frame for number, frame in enumerate(frames_of(300, start)) if number not in dropped]
    traffic, now = received(frames)
    assert traffic.quality(now).lost == len(dropped)


def test_nothing_is_lost_on_a_perfect_link_beyond_255() -> None:
    traffic, now = received(frames_of(1000))
    assert traffic.quality(now).lost == 0 and traffic.quality(now).loss == 0.0


def test_what_comes_late_or_twice_is_not_lost() -> None:
    frames = frames_of(300)
    frames[100], frames[101] = frames[101], frames[100]
    frames.insert(50, frames[49])
    frames.insert(200, frames[150])
    quality = received(frames)[0].quality(6.0)
    assert (quality.lost, quality.doubled) == (0, 2)


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.5])
def test_loss_is_that_of_the_last_seconds(loss: float) -> None:
    every = round(1 / loss) if loss else 10**9
    frames = [frame for number, frame in enumerate(frames_of(1000)) if number % every or number < 500]
    traffic, now = received(frames)
    assert traffic.quality(now).loss == pytest.approx(loss, abs=0.02)


def test_two_senders_have_counts_of_their_own() -> None:
    other = mavlink.MAVLink(None, 2, 1)
    mixed = []
    for frame in frames_of(100):
        other.seq = (other.seq + 1) % 256
        mixed += [frame, *GroundReader().feed(mavlink.MAVLink_ping_message(1, 1, 0, 0).pack(other))]
    assert received(mixed)[0].quality(4.0).lost == 0


def test_rates_are_measured_and_silence_is_none() -> None:
    traffic, now = received(frames_of(500), 0.02, decoded=True)
    (row,) = traffic.rows(now)
    assert (row.name, row.sender, row.total) == ("ATTITUDE", (1, 1), 500)
    assert row.rate == pytest.approx(50.0) and row.age == 0.0
    (silent,) = traffic.rows(now + 2 * WINDOW)
    assert silent.rate == 0.0 and silent.age == 2 * WINDOW
    quality = traffic.quality(now)
    assert quality.messages_per_s == pytest.approx(50.0, rel=0.01)
    # Zeros at a payload's end are not sent: 12 bytes of frame around 4 + 4.
    assert quality.bytes_per_s == pytest.approx(50.0 * 20, rel=0.01)


def test_a_field_is_remembered_with_its_times() -> None:
    traffic, _ = received(frames_of(10), 0.5, decoded=True)
    series = traffic.series("ATTITUDE", "roll")
    assert [at for at, _ in series] == [0.5 * n for n in range(10)]
    assert [value for _, value in series] == pytest.approx([0.1 * n for n in range(10)])
    assert traffic.series("ATTITUDE", "nothing") == [] and traffic.series("VFR_HUD", "alt") == []


def test_latency_is_the_way_there_and_back_of_our_own_questions() -> None:
    latency = Latency()
    for second in range(5):
        sync, _ = latency.questions(100.0 + second)
        assert latency.questions(100.5 + second) == ()
        latency.handle_message(mavlink.MAVLink_timesync_message(7, sync.ts1), 100.3 + second)
        latency.handle_message(mavlink.MAVLink_timesync_message(7, sync.ts1 + 1), 100.9 + second)
        latency.handle_message(mavlink.MAVLink_timesync_message(0, sync.ts1), 100.9 + second)
    assert latency.value(105.0) == pytest.approx(0.3)
    assert latency.value(130.0) is None


def test_a_ping_that_is_answered_counts_where_timesync_is_not() -> None:
    latency = Latency()
    _, ping = latency.questions(50.0)
    latency.handle_message(mavlink.MAVLink_ping_message(ping.time_usec, ping.seq, 0, 0), 50.05)
    assert latency.value(50.1) is None
    latency.handle_message(mavlink.MAVLink_ping_message(ping.time_usec, ping.seq, 255, 190), 50.12)
    assert latency.value(50.2) == pytest.approx(0.12, abs=1e-5)
