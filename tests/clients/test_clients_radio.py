"""The pair of pseudo-terminals does what a pair of serial radios does."""

from __future__ import annotations

import serial
from radio import BUFFER, Radio, radio


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
