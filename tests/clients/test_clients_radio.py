"""The pair of pseudo-terminals does what a pair of serial radios does."""

from __future__ import annotations

import time

import serial
from radio import BUFFER, Radio, Way, radio


def opened(ends: Radio) -> tuple[serial.Serial, serial.Serial]:
    return serial.Serial(ends.vehicle, timeout=10.0), serial.Serial(ends.ground, timeout=10.0)


def test_every_byte_arrives_unchanged_both_ways() -> None:
    sent = bytes(range(256)) * 20
    with radio() as ends:
        vehicle, ground = opened(ends)
        with vehicle, ground:
            vehicle.write(sent)
            assert ground.read(len(sent)) == sent
            ground.write(sent)
            assert vehicle.read(len(sent)) == sent


def test_a_vehicle_that_nobody_hears_does_not_stand_still() -> None:
    with radio() as ends:
        vehicle, ground = opened(ends)
        with vehicle, ground:
            for _ in range(8):
                vehicle.write(bytes(BUFFER))
            ground.write(b"still here")
            assert vehicle.read(10) == b"still here"


def test_a_slow_radio_carries_no_more_than_its_rate_and_loses_what_it_cannot_hold() -> None:
    way = Way(1024.0, 500)
    way.take(bytes(400), 10.0)
    assert way.due(10.0) == b"" and way.dropped == 0
    assert len(way.due(10.125)) == 128
    way.disconnected(60)  # the other side took no more
    assert len(way.due(10.125)) == 68
    way.take(bytes(300), 10.25)
    assert (way.dropped, way.fullest, len(way)) == (140, 500, 500)
    way.disconnected(len(way.due(99.0)))
    way.take(bytes(50), 100.0)
    assert len(way) == 50 and way.due(100.0) == b""


def test_a_slow_pair_delivers_every_byte_in_its_time() -> None:
    sent = bytes(range(256)) * 4
    with radio(20_000.0, 2048) as ends:
        vehicle, ground = opened(ends)
        with vehicle, ground:
            began = time.monotonic()
            vehicle.write(sent)
            assert ground.read(len(sent)) == sent
            assert time.monotonic() - began > 0.9 * len(sent) / 20_000.0
    assert ends.down.dropped == 0 and sum(size for _, size in ends.down.arrived) == len(sent)
