"""The two linear models of a steady flight beside each other: Floquet modes, and the stroke-averaged A and B."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.averaged import AveragedModel
from sim_bridge.flight_mechanics.modes import PHUGOID, SHORT_PERIOD, Mode, aliases
from sim_bridge.flight_mechanics.orbit import Orbit

POORLY_EXPLAINED = 0.02
"""-; unexplained fraction of variance with four states, above which A and B are reported as inaccurate"""
DOUBTFUL = 0.1
"""-; likewise, above which the eigenvalues of A are not named as modes of the aircraft"""
NEAR = 2.0
"""-; a wing mode within this factor of the short period's frequency is reported as coupled"""


class Linearization(NamedTuple):
    """Both linear models of one orbit."""

    floquet: list[Mode]
    """of the stroke map, slowest first"""
    averaged: AveragedModel


def averaged_modes(model: AveragedModel) -> list[Mode]:
    """Return the modes of A, slowest first: the two fastest eigenvalues are the short period, the others the
    phugoid.

    Modes have no names if four states leave more than `DOUBTFUL` unexplained.
    """
    roots = sorted((complex(root) for root in np.linalg.eigvals(model.a)), key=abs)
    named = [(root, PHUGOID if i < 2 else SHORT_PERIOD) for i, root in enumerate(roots)]
    clear = unexplained(model) <= DOUBTFUL
    return [
        Mode(root, 1.0, float(name == SHORT_PERIOD), name=name if clear else "")
        for root, name in named
        if root.imag >= 0.0
    ]


def unexplained(model: AveragedModel) -> float:
    """Return the largest unexplained fraction of a rate's variance."""
    return float(np.max(model.unexplained))


def warnings(linear: Linearization, orbit: Orbit) -> list[str]:
    """Return the warnings about these models, a sentence each."""
    frequency = orbit.inputs.frequency
    found = [
        f"{mode.name}: {mode.natural_frequency:.3g} rad/s is beyond half the flapping rate"
        f" ({np.pi * frequency:.3g} rad/s), where the logarithm of the stroke map may alias"
        for mode in linear.floquet
        if mode.name and aliases(mode, frequency)
    ]
    left = unexplained(linear.averaged)
    if left > POORLY_EXPLAINED:
        found.append(
            f"A and B leave {100.0 * left:.0f} % of the response to the elevator unexplained: more than four states"
            f" take part{'; read the modes of the stroke map (Floquet) instead' if left > DOUBTFUL else ''}"
        )
    return found


def difference(linear: Linearization) -> str:
    """Explain the difference between the short periods of both models; empty if one of them has none."""
    exact = next((mode for mode in linear.floquet if mode.name == SHORT_PERIOD), None)
    ours = next((mode for mode in averaged_modes(linear.averaged) if mode.name == SHORT_PERIOD), None)
    if exact is None or ours is None:
        return ""
    apart = ours.natural_frequency / exact.natural_frequency - 1.0
    text = (
        "The stroke map's modes are the exact decay of the motion left to itself; A and B are what four states"
        " explain of its answer to the elevator, as a flight test sees it:"
        f" a short period {100.0 * apart:+.1f} % in frequency."
    )
    near = [mode for mode in linear.floquet if _near(mode, exact)]
    if near:
        slow = f"{near[0].natural_frequency:.3g} rad/s"
        text += f" What moves it is a mode of the wings at {slow}, too slow to be left out without a trace."
    return text


def _near(mode: Mode, exact: Mode) -> bool:
    return not mode.name and not mode.lateral and mode.natural_frequency < NEAR * exact.natural_frequency
