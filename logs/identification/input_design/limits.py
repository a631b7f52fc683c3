"""How far a manoeuvre may take the aircraft from its trim, and the amplitude that this allows."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from logs.identification.input_design.prior import Prior
from logs.identification.input_design.response import Response


class Limits(NamedTuple):
    """Greatest changes from the trim; infinite where nothing bounds."""

    elevator: float = math.inf
    """rad; of the command"""
    pitch: float = math.inf
    """rad"""
    load: float = math.inf
    """m/s^2; of the specific force along z at the IMU"""
    alpha: float = math.inf
    """rad; angle of attack"""
    airspeed: float = math.inf
    """m/s"""


NAMES = {
    "elevator": ("elevator", "rad"),
    "pitch": ("pitch", "rad"),
    "load": ("a_z", "m/s^2"),
    "alpha": ("angle of attack", "rad"),
    "airspeed": ("airspeed", "m/s"),
}
"""what each is called, and its unit"""


def peaks(prior: Prior, response: Response, amplitude: float) -> Limits:
    """How far a manoeuvre of ``amplitude`` (rad) goes, stroke-averaged, by the prior."""
    u, w, _, theta = response.states.T
    reference = prior.reference
    airspeed = (u * reference.u + w * reference.w) / reference.airspeed
    alpha = (w * reference.u - u * reference.w) / reference.airspeed**2
    found = (theta, response.outputs[:, 2], alpha, airspeed)
    return Limits(abs(amplitude), *(float(np.max(np.abs(signal))) for signal in found))


def allowed(limits: Limits, reached: Limits) -> tuple[float, str]:
    """By what the amplitude that ``reached`` may be multiplied, and the limit that bounds it."""
    shares = {
        name: limit / peak if peak > 0.0 else math.inf
        for name, limit, peak in zip(Limits._fields, limits, reached, strict=True)
    }
    name = min(shares, key=lambda one: shares[one])
    return shares[name], name
