"""What a model leaves of an output beyond its noise: gusts, or something that the model lacks.

The intervals allow for residuals with a colour as for noise. A channel that is late by two or three samples at 25 Hz
left a fifth of M_q and a third of Z_alpha outside of theirs, and two to six hundredths of an output unexplained.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logs.identification.data.noise_level import noise_beside_steps
from logs.identification.results import FitSeries

TIMES, SHARE = 3.0, 0.01
"""-; residuals over the noise between neighbouring samples, and their share of the output's power, above both of
which it is said: slow noise of less power than that is no doubt"""
LEAST_SAMPLES = 20


def lacking(series: Sequence[FitSeries]) -> tuple[str, ...]:
    """One line for all fitted outputs of which the model leaves far more than its noise in any manoeuvre."""
    worst: dict[str, tuple[float, float]] = {}
    for one in series:
        left = None if one.held_out else _left(one)
        if left is not None and left > worst.get(one.output, (0.0, 0.0)):
            worst[one.output] = left
    if not worst:
        return ()
    (first, (times, share)), *others = worst.items()
    told = [f"what the model leaves of {first} is {times:.0f} times its noise, {_per_cent(share)} % of its power"]
    told += [f"of {name} {times:.0f} times, {_per_cent(share)} %" for name, (times, share) in others]
    return (
        f"{'; '.join(told)}: turbulence or slow noise, which the intervals hold, or a signal that is late, two"
        " manoeuvres in one, an input or a motion that the model lacks, which they do not",
    )


def _per_cent(share: float) -> str:
    """Whole per cents from 10 on, one digit below."""
    told = f"{100 * share:.1g}"
    return told if float(told) < 10.0 else f"{100 * share:.0f}"


def _left(one: FitSeries) -> tuple[float, float] | None:
    """Size of the residuals over their noise, and their share of the output's power; None where it is no doubt."""
    rest = one.measured - one.model
    known = np.isfinite(rest)
    noise = noise_beside_steps(rest)
    if np.count_nonzero(known) < LEAST_SAMPLES or not noise > 0:
        return None
    size, power = float(np.std(rest[known])), float(np.var(one.measured[known]))
    if size <= TIMES * noise or not size**2 > SHARE * power:
        return None
    return size / noise, size**2 / power if power > 0 else 1.0
