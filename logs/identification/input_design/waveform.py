"""The course of a planned input in time: the very shapes that `avionics.guidance.excitation` flies."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from avionics.guidance import excitation as flown
from avionics.guidance import multisine
from avionics.guidance.mission import Excitation
from logs.identification.results import Array


class Waveform(NamedTuple):
    """One manoeuvre: settle, input, settle, and half a stroke of calm on either side."""

    time: Array
    """s; (N,), from 0"""
    command: Array
    """rad; (N,), what is added to the elevator"""
    begin: float
    """s; when the manoeuvre begins"""
    end: float
    """s; when it is over"""


def waveform(asked: Excitation, step: float, fade: float, margin: float) -> Waveform:
    """One repeat of ``asked`` every ``step`` s; ``fade`` (s) of a sweep's ends, ``margin`` (s) before and after."""
    length = 2.0 * asked.settle + flown.duration(asked)
    time: Array = step * np.arange(int((length + 2.0 * margin) / step) + 1, dtype=np.float64)
    since = time - margin - asked.settle
    return Waveform(time, np.array([_value(asked, fade, t) for t in since.tolist()]), margin, margin + length)


def _value(asked: Excitation, fade: float, since: float) -> float:
    if not 0.0 <= since < flown.duration(asked):
        return 0.0
    if asked.shape in flown.SEGMENTS:
        return asked.amplitude * flown.steps(asked.shape, asked.width, since)
    if asked.shape in flown.SWEEPS:
        return asked.amplitude * flown.sweep(asked, fade, since)
    return multisine.value(flown.spectrum(asked)[asked.channel], since)
