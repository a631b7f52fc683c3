"""Smoothing and differentiation by a parabola through the neighbours of each sample.

Klein & Morelli, Aircraft System Identification, 2006, chapter 11; the weights are those of Savitzky & Golay,
Analytical Chemistry 36(8), 1964. At the ends the last whole parabola is used, off its middle.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

from logs.identification.data.smoothed import Smoothed, whole
from logs.identification.results import Array
from wingbeat.errors import InputError

NEIGHBOURS = 5
"""-; samples in a parabola, if nothing is asked"""


def local_quadratic(values: Array, step: float, width: int = NEIGHBOURS) -> Smoothed:
    """Smoothed ``values`` (N,), ``step`` s apart, by parabolas over ``width`` samples (odd, five or more).

    The standard errors are those of white noise; what the parabola bends off the signal is not in them.

    Raises:
        InputError: the width is even or under five, too few samples, or some are missing.
    """
    if width < NEIGHBOURS or width % 2 == 0:
        raise InputError(f"a parabola over {width} samples: the width must be odd and {NEIGHBOURS} or more")
    whole(values, width + 2)
    smooth, rates = (savgol_filter(values, width, 2, deriv=order, delta=step, mode="interp") for order in (0, 1))
    own = float(savgol_coeffs(width, 2)[width // 2])
    inner = slice(width // 2, len(values) - width // 2)
    # The hat of a parabola is a projection: the squares of its weights add up to the middle one.
    noise = float(np.sqrt(np.mean((values - smooth)[inner] ** 2) / (1 - own)))
    shares = [_lengths(width, len(values), order, step) for order in (0, 1)]
    return Smoothed(smooth, rates, noise, noise * shares[0], noise * shares[1])


def _lengths(width: int, count: int, order: int, step: float) -> Array:
    """Root of the sum of the squared weights that each of ``count`` samples gets its smoothed value (slope) with."""
    half = width // 2
    places = np.clip(np.arange(count), half, count - 1 - half)
    inside = np.arange(count) - places + half
    table = [savgol_coeffs(width, 2, deriv=order, delta=step, pos=place, use="dot") for place in range(width)]
    lengths: Array = np.linalg.norm(np.array(table), axis=1)[inside]
    return lengths
