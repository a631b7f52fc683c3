"""Result of a smoother, and checks of its input."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.results import Array
from wingbeat.errors import InputError


class Smoothed(NamedTuple):
    """A smoothed signal and its derivative."""

    values: Array
    """as the signal; (N,)"""
    rates: Array
    """as the signal, per s; (N,)"""
    noise: float
    """as the signal; standard deviation of the noise"""
    value_errors: Array | None = None
    """as the signal; (N,) standard errors of `values`, None if the method has none"""
    rate_errors: Array | None = None
    """as the signal, per s; (N,) standard errors of `rates`, None if the method has none"""


def whole(values: Array, least: int) -> Array:
    """``values`` (N,) as they are.

    Raises:
        InputError: fewer than ``least`` samples, or some are not finite.
    """
    if values.ndim != 1 or len(values) < least:
        raise InputError(f"a signal of {values.shape} samples is too short to be smoothed: {least} are needed")
    missing = int(np.sum(~np.isfinite(values)))
    if missing:
        raise InputError(
            f"{missing} of the signal's {len(values)} samples are missing: fill short gaps or split it first"
        )
    return values


def half_power(step: float, cut_off: float) -> float:
    """The cut-off in rad a sample from Hz.

    Raises:
        InputError: it does not lie between zero and half the sampling rate.
    """
    if not 0 < cut_off < 0.5 / step:
        raise InputError(
            f"a cut-off of {cut_off:g} Hz is not between 0 and {0.5 / step:g} Hz, half the sampling rate"
        )
    return 2 * np.pi * cut_off * step
