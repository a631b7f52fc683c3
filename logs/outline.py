"""Outline of a simulated vehicle for viewers."""

from __future__ import annotations

import math

from logs.scene import Shape
from sim_bridge.mechanism import chord_shape, place_of
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vehicles.sections import Plate

STEPS = 8
"""number of drawn strips of a wing"""


def shape_of(vehicle: SimulatedVehicle) -> Shape:
    """Return the outline of a simulated vehicle. The tail is a square of its area, the fin half as high as long."""
    wing, level, upright = vehicle.wing, _largest(vehicle, 2), _largest(vehicle, 1)
    side = math.sqrt(level.area) if level else 0.0
    tail = place_of(vehicle, level.body, level.place) if level else (0.0, 0.0, 0.0)
    hinge = place_of(vehicle, wing.right)
    return Shape(
        semispan=wing.semispan,
        chord=wing.root_chord,
        hinge=(hinge[0], hinge[1], -hinge[2]),
        nose=vehicle.fuselage.contact_nose,
        tail=(tail[0] + side / 4.0, 0.0, -tail[2]),
        tail_span=side,
        tail_chord=side,
        fin_height=math.sqrt(upright.area / 2.0) if upright else 0.0,
        body_radius=vehicle.fuselage.contact_below,
        chords=tuple(chord_shape(wing.planform, place / STEPS) for place in range(STEPS + 1)),
    )


def _largest(vehicle: SimulatedVehicle, axis: int) -> Plate | None:
    """Return the largest plate whose normal is mainly along the axis (1 across, 2 down)."""
    facing = [plate for plate in vehicle.plates.values() if abs(plate.normal[axis]) > math.sqrt(0.5)]
    return max(facing, key=lambda plate: plate.area, default=None)
