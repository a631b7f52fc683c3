"""The modelled transmitter and its receiver."""

from __future__ import annotations

import numpy as np
import pytest
from sensors_bench import cruise

from sim_bridge.sensors.noise import sensor_seed
from sim_bridge.sensors.receiver import FULL_RSSI, Pilot, Receiver, ReceiverSpec, Sticks, pulses
from wingbeat.samples import ReceiverSample

SPEC = ReceiverSpec()


def received(pilot: Pilot | None, seconds: float, north: float = 20.0, seed: int = 3) -> list[ReceiverSample | None]:
    receiver = Receiver(SPEC, sensor_seed(seed, 8), pilot)
    return [
        receiver.read(cruise(4 * frame, position_ned=(north, 0.0, -10.0))) for frame in range(round(seconds * 50))
    ]


def hands_off(observed: object) -> Sticks:
    return Sticks()


def test_without_a_pilot_nothing_is_heard() -> None:
    assert received(None, 2.0) == [None] * 100


def test_sticks_and_switches_have_the_usual_pulses() -> None:
    assert pulses(Sticks(1.0, -1.0, 0.0, 0.5, 2, 0, 1)) == (2000, 1000, 1000, 1750, 2000, 1000, 2000, 1500)
    assert pulses(Sticks(7.0, -7.0, 1.0, 0.0, 1, 1, 0)) == (2000, 1000, 2000, 1500, 1500, 2000, 1000, 1500)


def test_pulses_are_whole_microseconds_about_what_is_sent() -> None:
    frames = [frame for frame in received(hands_off, 40.0) if frame]
    channels = np.array([frame.pulses for frame in frames])
    assert channels.dtype.kind == "i"
    # Rounding adds a twelfth of a microsecond squared.
    expected = np.sqrt(SPEC.jitter**2 + 1.0 / 12.0)
    assert channels.std(axis=0) == pytest.approx(np.full(8, expected), rel=0.1)
    assert np.abs(channels.mean(axis=0) - pulses(Sticks())).max() < 5.0 * expected / np.sqrt(len(frames))


@pytest.mark.parametrize("distance", [700.0, 1000.0, 1100.0])
def test_frames_are_lost_with_the_distance(distance: float) -> None:
    frames = received(hands_off, 60.0, north=distance)
    lost = sum(frame is None or frame.lost == 1 for frame in frames) / len(frames)
    share = Receiver(SPEC, sensor_seed(1, 8), None).lost_share(np.hypot(distance, 10.0))
    assert lost == pytest.approx(share, abs=5.0 * np.sqrt(share * (1.0 - share) / len(frames)) + 1e-3)


def test_the_signal_weakens_with_the_distance() -> None:
    receiver = Receiver(SPEC, sensor_seed(1, 8), None)
    strengths = [receiver.strength(distance) for distance in (0.5, 5.0, 50.0, 500.0, 2000.0, 1e5)]
    assert strengths[0] == FULL_RSSI
    assert strengths == sorted(strengths, reverse=True)
    assert strengths[-1] == strengths[-2] == 1


def test_a_transmitter_that_is_switched_off_is_missed_and_then_said_to_be_lost() -> None:
    frames = received(lambda observed: Sticks(roll=0.5) if observed.time_us < 1_000_000 else None, 2.0)
    assert all(frame is not None and not frame.lost for frame in frames[:50])
    silence = round(SPEC.timeout * 50) - 1
    assert frames[50 : 50 + silence] == [None] * silence
    last = frames[49]
    assert last is not None
    for frame in frames[51 + silence :]:
        assert frame is not None and (frame.lost, frame.rssi, frame.pulses) == (1, 0, last.pulses)


def test_one_seed_is_one_flight() -> None:
    assert received(hands_off, 5.0, 990.0) == received(hands_off, 5.0, 990.0)
    assert received(hands_off, 5.0, 990.0) != received(hands_off, 5.0, 990.0, seed=4)
