"""Derivatives whose sign no aircraft has: the air brakes what moves in it, and lifts with the angle of attack.

Etkin & Reid, Dynamics of Flight, 3rd ed., 1996, ch. 5: damping in pitch, roll and yaw, side force against the
sideslip, lift with the angle of attack, drag. A fit follows a signal with its sign turned as well as the right one.
"""

from __future__ import annotations

from collections.abc import Sequence

from logs.identification.results import Estimate

OF_MODELS = {
    "Z_alpha": -1, "M_q": -1, "X_u": -1, "Y_beta": -1, "L_p": -1, "N_r": -1,
    "C_D_0": 1, "C_L_alpha": 1, "C_m_q": -1,
}  # fmt: skip
"""sign of a parameter of output error"""
OF_RESPONSES = {
    ("C_L", "alpha"): 1, ("C_Z", "alpha"): -1, ("C_m", "q*c/2V"): -1, ("C_Y", "beta"): -1,
    ("C_l", "p*b/2V"): -1, ("C_n", "r*b/2V"): -1, ("C_D", "intercept"): 1,
    ("C_m", "q"): -1, ("C_l", "p"): -1, ("C_n", "r"): -1,
}  # fmt: skip
"""sign of a coefficient by response and regressor"""


def turned(estimates: Sequence[Estimate], response: str = "") -> tuple[str, ...]:
    """A line that names the estimates whose whole interval has the other sign; of a regression's ``response``."""
    names = []
    for one in estimates:
        sign = OF_RESPONSES.get((response, one.name)) if response else OF_MODELS.get(one.name)
        if sign is not None and max(sign * one.low, sign * one.high) < 0:
            names.append(one.name)
    if not names:
        return ()
    which = "has the sign" if len(names) == 1 else "have the signs"
    return (
        f"{', '.join(names)} {which} of no aircraft: is the sign, the unit or the place of a sensor wrong,"
        " or is it two parameters that only their sum tells?",
    )
