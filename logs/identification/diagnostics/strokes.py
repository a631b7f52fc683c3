"""Coefficients of strokes that no wing has: forces in another unit, a signal of the other sign.

A section's lift is square to its way through the air and does no work; what the air takes of its motion is its
drag's. So a C_D below zero says that air at rest pushes the wings along, as turned signals do on nearly every run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from logs.identification.results import Estimate, Fitted, Unidentified

HIGHEST = 10.0
"""-; beyond any wing's mean coefficient: a plate square to the stream has 2, a fly's wing with all its vortices 4"""


class Signs(NamedTuple):
    """1 or -1, by which signals are multiplied."""

    flap: float = 1.0
    force_x: float = 1.0
    force_z: float = 1.0


AS_TOLD = Signs()
TURNED = {
    "flap (wing up positive)": Signs(flap=-1.0),
    "force_x (forward positive)": Signs(force_x=-1.0),
    "force_z (down positive)": Signs(force_z=-1.0),
}


def without_impossible(told: Fitted) -> Fitted:
    """Without any number where one lies beyond `HIGHEST` with its whole interval: all forces are off by a factor."""
    high = [one for one in told.estimates if one.low > HIGHEST or one.high < -HIGHEST]
    if not high:
        return told
    named = max(high, key=lambda one: abs(one.value))
    why = (
        f"{named.name} would be {named.value:.3g}, and no wing's is beyond {HIGHEST:g}: are the forces in the unit"
        " told (N, gf), planform in m, V in its unit?"
    )
    lost = tuple(Unidentified(one.name, why) for one in told.estimates)
    return told._replace(estimates=(), unidentified=(*told.unidentified, *lost), correlation=None, series=())


def doubts(told: Fitted, again: Callable[[Signs], tuple[Estimate, ...]]) -> tuple[str, ...]:
    """A line where C_D is below zero in its whole interval, with the signals that turned round would make it none.

    Args:
        told: the coefficients.
        again: the coefficients with signals turned.
    """
    below = _below(told.estimates)
    if not below:
        return ()
    mended = [name for name, signs in TURNED.items() if _mends(below, again(signs))]
    more = f"with {' or '.join(mended)} turned round it would not" if mended else "are weight and inertia taken off?"
    return (f"{' and '.join(below)} below zero: air at rest would push the wings along; {more}",)


def _mends(below: list[str], found: tuple[Estimate, ...]) -> bool:
    """Whether those ``below`` zero are ``found`` again, and no C_D is below zero now."""
    return set(below) <= {one.name for one in found} and not _below(found)


def _below(estimates: tuple[Estimate, ...]) -> list[str]:
    return [one.name for one in estimates if one.name.startswith("C_D") and one.high < 0.0]
