"""Finds the strokes of the wing in what shakes with it, for logs in which no wing topic tells the phase.

Averages over one stroke need its length, not where it begins: the phase of the fundamental of any signal that
flapping repeats will do, be it a wing angle or the specific force of the body.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, find_peaks, hilbert, sosfiltfilt, welch

from logs.identification.results import Array
from wingbeat.errors import InputError

SLOWEST, FASTEST = 1.5, 30.0
"""Hz; of flapping"""
RESOLUTION = 0.25
"""Hz; of the spectrum in which it is looked for"""
LINE = 30.0
"""-; a line stands so far above the median of the spectrum"""
ROUNDING = 1e-9
"""1/Hz; of the mean square: less is what computing leaves of a straight line"""
FUNDAMENTAL = 0.02
"""-; of the strongest line: a weaker one is no fundamental of it"""
BAND = 0.35
"""-; of the flapping frequency, on either side: what is taken for the fundamental"""
SMOOTHED = 3.0
"""-; strokes over which their rate is a mean: a manoeuvre shakes the body too"""
STANDING = 0.2
"""-; of the usual size of the shaking: below it the wings stand still"""


def strokes_in(time: Array, signal: Array) -> Array:
    """Strokes (N,) since the first sample, never decreasing, from a ``signal`` (N,) that flapping repeats.

    ``time`` (N,) in s, equally spaced.

    Raises:
        InputError: nothing repeats itself in it as wings do.
    """
    step = float(time[1] - time[0])
    frequency = flapping_frequency(step, signal)
    low, high = (1 - BAND) * frequency, min((1 + BAND) * frequency, 0.45 / step)
    shaking = hilbert(sosfiltfilt(butter(2, (low, high), "bandpass", fs=1 / step, output="sos"), signal))
    size = np.abs(shaking)
    turned = np.diff(np.unwrap(np.angle(shaking)), prepend=np.angle(shaking[0])) / (2 * np.pi)
    turned[0] = 0.0
    flapping = size > STANDING * np.quantile(size, 0.9)
    rate = uniform_filter1d(np.where(flapping, turned, 0.0), round(SMOOTHED / (frequency * step)), mode="nearest")
    strokes: Array = np.maximum.accumulate(np.cumsum(rate))
    return strokes


def flapping_frequency(step: float, signal: Array) -> float:
    """Hz; fundamental of what repeats itself in a ``signal`` (N,) sampled every ``step`` s.

    Raises:
        InputError: nothing does as wings do.
    """
    length = min(round(1 / (RESOLUTION * step)), len(signal))
    at, power = welch(signal, 1 / step, nperseg=length, detrend="linear")
    inside = (at >= SLOWEST) & (at <= FASTEST)
    at, power = at[inside], power[inside]
    lines, _ = find_peaks(power) if len(power) else (np.zeros(0, int), {})
    dust = ROUNDING * float(np.mean(np.square(signal)))
    lines = lines[power[lines] > LINE * np.median(power) + dust] if len(lines) else lines
    if not len(lines):
        raise InputError("nothing in it repeats itself as wings do")
    strongest = lines[np.argmax(power[lines])]
    ratio = at[strongest] / at[lines]
    harmonic = (np.abs(ratio - np.round(ratio)) < RESOLUTION / at[lines]) & (ratio > 0.9)
    fundamental = harmonic & (power[lines] > FUNDAMENTAL * power[strongest])
    return float(at[lines][fundamental].min())
