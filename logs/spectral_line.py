"""Strongest line of a signal's spectrum: the flapping frequency of an acceleration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PADDING = 8
"""transform length over the signal's: the frequency is read to an eighth of the resolution"""


class Line(NamedTuple):
    """Largest value of a periodogram."""

    frequency: float
    """Hz; 0 without a line"""
    distinction: float
    """-; its power over the mean power of the band"""


def strongest_line(signal: NDArray[np.float64], step: float, band: tuple[float, float], highest: float = 0.4) -> Line:
    """Return the strongest line of an evenly sampled signal, with a Hann window and without its mean.

    Args:
        signal: (n,).
        step: s between samples.
        band: Hz; lowest and highest frequency.
        highest: limit of the band in cycles per sample.
    """
    count = PADDING * len(signal)
    frequency = np.fft.rfftfreq(count, step)
    inside = (frequency > band[0]) & (frequency < min(band[1], highest / step))
    values = signal - signal.mean()
    if not inside.any() or not values.any():
        return Line(0.0, 0.0)
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)), count))[inside] ** 2
    place = int(power.argmax())
    return Line(float(frequency[inside][place]), float(power[place] / power.mean()))
