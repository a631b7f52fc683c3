"""E2-500 optical encoders on the wing shafts."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

from avionics.quantities import Quantity


class EncoderSpec(NamedTuple):
    """E2-500 (US Digital): 500 cycles a turn, four edges a cycle: 2000 counts, 0.18 deg (Gerdes Table 1).

    A count is a place, not a measurement: there is no noise, and the counter holds the last edge passed. The
    counters are set when the vehicle is powered up in its jig, so the zeros are known to within that jig.
    """

    counts_per_turn: Annotated[int, Quantity("counts", 4, 1000000)]
    """of the wing's shaft, all four edges"""
    zero_left: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """of the left encoder with its wing level"""
    zero_right: Annotated[float, Quantity("counts", -1e6, 1e6)]
    """of the right encoder with its wing level"""


class Encoder:
    """Both wings' encoders and their counters."""

    def __init__(self, spec: EncoderSpec) -> None:
        self._spec = spec
        self._counts_per_rad = spec.counts_per_turn / math.tau

    def read(self, flap_left: float, flap_right: float) -> tuple[int, int]:
        """Counts of the left and right wing at these flap angles in rad, positive with the wing up."""
        return (
            math.floor(flap_left * self._counts_per_rad + self._spec.zero_left),
            math.floor(flap_right * self._counts_per_rad + self._spec.zero_right),
        )
