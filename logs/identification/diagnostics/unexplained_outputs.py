"""Derivatives of equations whose outputs the model does not explain: the fit is sure of numbers that mean nothing.

Of an aircraft that gusts alone moved, of which the model explained 1 %, the interval of M_q held in none of 12; in
turbulence that rolled an aircraft the roll by its rudder came out with the wrong sign, sure of it, beside a roll
acceleration that the model followed worse than its mean does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logs.identification.results import FitSeries, Fitted, Unidentified
from logs.identification.statistics.output_fit import output_fits
from logs.identification.tables.results import EXPLAINS_LITTLE, LITTLE

EQUATIONS = {
    "X_": ("u", "V", "a_x"), "Z_": ("alpha", "a_z"), "M_": ("q", "theta", "q_dot"),
    "Y_": ("beta", "a_y"), "L_": ("p", "phi", "p_dot"), "N_": ("r", "r_dot"),
    "C_D_": ("V", "a_x"), "C_L_": ("alpha", "a_z"), "C_m_": ("q", "theta", "q_dot"),
}  # fmt: skip
"""outputs that show what an equation does, by how its derivatives' names begin"""


def without_unexplained(told: Fitted) -> Fitted:
    """Without the numbers of equations whose outputs the fitted model follows little, where the rest is not white.

    That is with less than half of all their outputs, or one of them worse than its mean would; with less than half of
    every output of the model all numbers go.
    """
    poor = _explained(told.series)
    if poor and all(share < LITTLE for share in poor.values()):
        reasons = {one.name: EXPLAINS_LITTLE for one in told.estimates}
    else:
        reasons = {one.name: why for one in told.estimates if (why := _reason(one.name, poor))}
    if not reasons:
        return told
    refused = tuple(Unidentified(name, why) for name, why in reasons.items())
    kept = tuple(one for one in told.estimates if one.name not in reasons)
    return told._replace(estimates=kept, unidentified=(*refused, *told.unidentified), correlation=None)


def _explained(series: Sequence[FitSeries]) -> dict[str, float]:
    """Of each fitted output its share that the model explains over all manoeuvres; 1 where what is left is white."""
    fitted = tuple(one for one in series if not one.held_out)
    coloured = {each.output for each in output_fits(fitted) if each.white is False}
    left, power = (
        dict.fromkeys((one.output for one in fitted), 0.0),
        dict.fromkeys((one.output for one in fitted), 0.0),
    )
    for one in fitted:
        known = np.isfinite(one.measured)
        if known.any():
            values = one.measured[known]
            left[one.output] += float(np.sum((values - one.model[known]) ** 2))
            power[one.output] += float(np.sum((values - values.mean()) ** 2))
    return {name: 1.0 - left[name] / power[name] if name in coloured and power[name] > 0 else 1.0 for name in left}


def _reason(name: str, explained: dict[str, float]) -> str:
    """Why a derivative goes, empty where it may stay."""
    prefix = next((one for one in sorted(EQUATIONS, key=len, reverse=True) if name.startswith(one)), "")
    shares = {output: explained[output] for output in EQUATIONS.get(prefix, ()) if output in explained}
    worst = min(shares, key=lambda output: shares[output], default="")
    if not worst or not (shares[worst] < 0.0 or all(share < LITTLE for share in shares.values())):
        return ""
    if shares[worst] < 0.0:
        return f"the model follows {worst} worse than its mean"
    return f"the model explains less than half of {', '.join(shares)}"
