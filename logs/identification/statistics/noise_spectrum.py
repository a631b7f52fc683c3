"""The spectrum of a fit's noise as a power law in frequency, by what the fit leaves.

What a fit leaves of an ordinate is smaller than its noise where its unknowns take most of it: at the lowest
frequencies of short records, which each have ends of their own, next to nothing is left. Taken for little noise that
gave those ordinates all the weight: of flights with 0.8 s of rest around each input the equivalent system's frequency
came out 23 % too low and was held in 5 of 40, by what each ordinate has left of its noise it is right and held.
"""

from __future__ import annotations

import numpy as np

from logs.identification.results import Array

LEAST_LEFT = 1e-3
"""-; of an ordinate's degrees of freedom: one of which less is left tells nothing"""
LEAST_POWER = 1e-300
"""-; in place of none, which has no logarithm"""


def power_law(frequency: Array, power: Array, degrees: Array) -> Array:
    """Level and slope (2,) of ``log S = level + slope log f`` by least squares.

    ``power`` (F,) are squares of real and imaginary part together. Of noise of the variance ``S`` in each the fit
    leaves ``degrees`` (F,) ``S`` on the mean, two where no unknown took from the ordinate (Belsley, Kuh & Welsch,
    Regression Diagnostics, 1980, Eq. 2.7). A normal residual that is smaller scatters as before in proportion: the
    logarithm of its power has the mean ``log(degrees S)`` less Euler's constant, as chi-squared of two (Bartlett &
    Kendall, J. R. Stat. Soc. Suppl. 8(1), 1946). Each counts by its degrees, for what little is left of one is a
    mixture of its neighbours. One large residual, that no noise made, bends a line through logarithms less than the
    likelihood of the powers themselves. ``frequency`` (F,) is in any unit.
    """
    left = np.maximum(degrees, LEAST_LEFT)
    logs = np.log(power + LEAST_POWER) - np.log(left) + np.euler_gamma
    worth = np.sqrt(left / 2.0)
    columns = np.column_stack((np.ones_like(left), np.log(frequency)))
    found: Array = np.linalg.lstsq(columns * worth[:, None], logs * worth, rcond=None)[0]
    return found
