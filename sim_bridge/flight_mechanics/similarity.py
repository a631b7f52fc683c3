"""Similarity numbers of a flapping wing, and the ranges in which an aerodynamic model holds.

Definitions of Han et al. 2017, Eq. 1 and 2: advance ratio J = U / U_tip with the mean tip speed U_tip = 2 Phi f R
(Phi peak to peak), Reynolds number (U_tip + U) c / nu with the mean chord c. Reduced frequency k = pi f c / U.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.models import find_model
from sim_bridge.aerodynamics.protocol import AerodynamicModel, Strips, aspect_ratio
from sim_bridge.aerodynamics.quasi_steady import reach_of
from sim_bridge.aerodynamics.strip_theory import KINEMATIC_VISCOSITY
from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.mechanism import wing_strips
from sim_bridge.vehicles import SimulatedVehicle

WORDS = {
    "advance_ratio": "advance ratio",
    "reynolds": "Reynolds number",
    "reduced_frequency": "reduced frequency",
    "aspect_ratio": "aspect ratio",
}
"""name of each field of `SimilarityNumbers`"""


class SimilarityNumbers(NamedTuple):
    """Similarity numbers of a pair of wings."""

    advance_ratio: float
    """-; airspeed over mean tip speed; infinite without flapping"""
    reynolds: float
    """-; mean chord, sum of airspeed and mean tip speed"""
    reduced_frequency: float
    """-; pi f c / U, mean chord; infinite without airspeed"""
    aspect_ratio: float
    """-; span from tip to tip, squared, over the area"""


class RangeExcess(NamedTuple):
    """Similarity number outside the range of a model."""

    model: str
    quantity: str
    """field of `SimilarityNumbers`"""
    value: float
    limit: float
    """the limit that is exceeded"""
    source: str
    """of the limit"""


def similarity_numbers(strips: Strips, airspeed: float, stroke: float, frequency: float) -> SimilarityNumbers:
    """Compute the numbers of a pair of wings.

    Args:
        strips: of both wings.
        airspeed: m/s.
        stroke: rad, peak to peak.
        frequency: Hz.
    """
    reach = reach_of(strips)
    chord = float(np.sum(strips.chord * strips.width)) / (2.0 * reach)
    tip = 2.0 * stroke * frequency * reach
    return SimilarityNumbers(
        airspeed / tip if tip > 0.0 else math.inf,
        (tip + airspeed) * chord / KINEMATIC_VISCOSITY,
        math.pi * frequency * chord / airspeed if airspeed > 0.0 else math.inf,
        aspect_ratio(strips),
    )


def range_excesses(model: AerodynamicModel, numbers: SimilarityNumbers) -> list[RangeExcess]:
    """Return the numbers outside the ranges of a model."""
    found = []
    for valid in model.ranges:
        value = getattr(numbers, valid.quantity)
        if not valid.low <= value <= valid.high:
            limit = valid.low if value < valid.low else valid.high
            found.append(RangeExcess(model.name, valid.quantity, value, limit, valid.source))
    return found


def cruise_excesses(vehicle: SimulatedVehicle) -> list[RangeExcess]:
    """Return the numbers outside the range of the vehicle's model at the cruise of its file."""
    cruise = vehicle.cruise
    crank = vehicle.drive.kind == "crank" and vehicle.drive.crank_amplitude > 0.0
    half = vehicle.drive.crank_amplitude if crank else cruise.stroke_amplitude
    numbers = similarity_numbers(wing_strips(vehicle.wing)[0], cruise.airspeed, 2.0 * half, cruise.frequency)
    return range_excesses(find_model(vehicle.aerodynamics.model), numbers)


def orbit_excesses(vehicle: SimulatedVehicle, orbit: Orbit) -> list[RangeExcess]:
    """Return the numbers outside the range of the vehicle's model in a trimmed flight."""
    numbers = similarity_numbers(
        wing_strips(vehicle.wing)[0], orbit.means.airspeed, 2.0 * orbit.means.flap_amplitude, orbit.inputs.frequency
    )
    return range_excesses(find_model(vehicle.aerodynamics.model), numbers)
