"""Radio-control transmitter of a pilot and the receiver on board."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import SensorSeed, split
from wingbeat.samples import CHANNELS, ReceiverSample

FULL_RSSI = 254
"""-; the strongest signal that the wire can carry"""
CENTRE, HALF_TRAVEL = 1500.0, 500.0
"""us; of every channel: the usual 1000 to 2000"""


class Sticks(NamedTuple):
    """Stick and switch positions."""

    roll: float = 0.0
    """-; -1 left to 1 right"""
    pitch: float = 0.0
    """-; -1 stick forward, nose down, to 1 stick back, nose up"""
    throttle: float = 0.0
    """-; 0 to 1"""
    yaw: float = 0.0
    """-; -1 left to 1 right"""
    mode: int = 0
    """-; position of the mode switch: 0 low, 1 middle, 2 high"""
    arm: int = 0
    """-; 1 with the arm switch on"""
    kill: int = 0
    """-; 1 with the kill switch on"""


Pilot = Callable[[Observation], Sticks | None]
"""what a pilot does who sees the bird; None while the transmitter is off"""


def standing_by(received: Observation) -> Sticks:
    """Return a pilot who does not steer: sticks centered, throttle closed, switches low."""
    return Sticks()


class ReceiverSpec(NamedTuple):
    """A 2.4 GHz sports receiver with a serial output; every value chosen, of no particular product."""

    jitter: float = 0.7
    """us; one sigma of a pulse, new in every frame, before it is rounded to 1 us"""
    range: float = 1000.0
    """m; at which half of the frames are lost"""
    fading: float = 60.0
    """m; over which that share falls to 27 %, nearer"""
    timeout: float = 0.3
    """s; without a frame before the receiver reports the signal as lost"""


def pulses(sticks: Sticks) -> tuple[float, ...]:
    """Pulse widths (us) of roll, pitch, throttle, yaw, mode, arm, kill and a spare channel."""
    switches = (0.5 * sticks.mode, float(sticks.arm), float(sticks.kill))
    axes = (sticks.roll, sticks.pitch, 2.0 * sticks.throttle - 1.0, sticks.yaw)
    travel = (*axes, *(2.0 * position - 1.0 for position in switches), 0.0)
    return tuple(CENTRE + HALF_TRAVEL * min(max(part, -1.0), 1.0) for part in travel)


class Receiver:
    """Receiver of a pilot's transmitter; `read` at 50 Hz. There is none without a pilot."""

    def __init__(self, spec: ReceiverSpec, seed: SensorSeed, pilot: Pilot | None) -> None:
        _, self._noise = split(seed)
        self._spec = spec
        self._pilot = pilot
        self._last_sample: tuple[int, ...] | None = None
        self._received_us = 0

    def read(self, observation: Observation) -> ReceiverSample | None:
        """Return one frame; None if it was lost or before the first.

        After `ReceiverSpec.timeout` without a signal the last frame is repeated and marked as lost.
        """
        if self._pilot is None:
            return None
        sticks = self._pilot(observation)
        draws = self._noise.standard_normal(CHANNELS)
        distance = math.hypot(*observation.position_ned)
        through = self._noise.random() >= self.lost_share(distance)
        time_us = observation.time_us
        if sticks is not None and through:
            self._received_us = time_us
            sent = zip(pulses(sticks), draws.tolist(), strict=True)
            self._last_sample = tuple(round(pulse + self._spec.jitter * draw) for pulse, draw in sent)
            return ReceiverSample(time_us, self._last_sample, 0, self.strength(distance))
        if self._last_sample is None or time_us - self._received_us < self._spec.timeout * 1e6:
            return None
        return ReceiverSample(time_us, self._last_sample, 1, 0)

    def lost_share(self, distance: float) -> float:
        """Fraction of frames lost at ``distance`` m from the transmitter."""
        return 1.0 / (1.0 + math.exp(min((self._spec.range - distance) / self._spec.fading, 700.0)))

    def strength(self, distance: float) -> int:
        """Signal strength of a received frame: linear in the logarithm of the distance, 1 at twice the range."""
        ratio = max(distance, 1.0) / (2.0 * self._spec.range)
        return max(1, min(FULL_RSSI, round(FULL_RSSI * -math.log(ratio) / math.log(2.0 * self._spec.range))))
