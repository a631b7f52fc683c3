"""Hawkmoth and entomopter in free flight beside the little that Han and Sibilski print of it."""

from __future__ import annotations

import math

import numpy as np

from sim_bridge.flight_mechanics.hover import (
    PITCH,
    HoverMap,
    HoverOrbit,
    U,
    X,
    Z,
    air_power,
    fly,
    growth,
    hover,
    level_pitch,
    linearize,
    open_loop,
    position_gain,
)
from sim_bridge.mechanism import total_mass
from sim_bridge.validation.row import Row, figure, unreproducible
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle

HAWKMOTH, ENTOMOPTER = "hawkmoth", "entomopter"
STROKE_PLANES = ((2.9, 44.4), (5.0, 56.3))
"""m/s, deg; Han, text at Fig. 9"""
POWER = 30.0
"""W/kg; Sibilski, introduction: typical of insects"""
SHARE, STROKES = 0.95, 10
"""frequency relative to hover, and number of strokes of the open loop"""
TOLERANCES = np.array((0.2, 0.2, 2.0, 0.1, 0.02, 0.02, math.inf))
"""state tolerances of the regulator for `position_gain`: equal costs, crank speed unweighted"""
AUTHORITY = np.array((0.1, 0.1))
"""of throttle, and of elevator in rad"""
PUSH = {U: 0.1, PITCH: 0.05}
"""initial disturbance of hover: 0.1 m/s and 0.05 rad"""
CHOSEN = "wing motion, wings and body are not printed: all of it is chosen"
NO_SCALE = "Fig. 4 has no scale that could be read, and masses and wing motion are not printed: chosen"
HELD = "by a regulator of the linearised orbit, fed back once a stroke; the paper has no controller"


def moth_rows() -> list[Row]:
    """Compare stroke planes of the moth in level flight, and power and divergence of its hover."""
    moth = load_vehicle(HAWKMOTH)
    planes = [
        unreproducible(
            figure("text at Fig. 9", f"stroke plane, {speed:g} m/s", "deg", printed),
            math.degrees(stroke_plane(moth, speed)),
            CHOSEN,
        )
        for speed, printed in STROKE_PLANES
    ]
    orbit = hover(moth)
    return [*planes, _divergence_row(moth, orbit)]


def drift_rows() -> list[Row]:
    """Compare the open loop of Fig. 4: an oscillation on a vertical drift."""
    drift, swing = drift_and_swing(load_vehicle(ENTOMOPTER))
    return [
        _unprinted("Fig. 4", "vertical drift at 95 % of hover's frequency, down", "m/s^2", drift, NO_SCALE),
        _unprinted("Fig. 4", "swing of the vertical speed on it, twice a stroke", "m/s", swing, NO_SCALE),
    ]


def hover_rows() -> list[Row]:
    """Compare the power of hover, its divergence, and its control."""
    vehicle = load_vehicle(ENTOMOPTER)
    orbit = hover(vehicle)
    power = figure("1 Introduction", "power of insects in hover", "W/kg", POWER)
    computed = air_power(vehicle, orbit) / total_mass(vehicle)
    held = hover_excursion(vehicle, orbit)
    return [
        unreproducible(power, computed, f"work on the air alone; {CHOSEN}"),
        _divergence_row(vehicle, orbit),
        _unprinted("-", "farthest from hover in 100 strokes after 0.1 m/s, 0.05 rad", "m", held, HELD),
    ]


def _unprinted(where: str, quantity: str, unit: str, computed: float, why: str) -> Row:
    return unreproducible(figure(where, quantity, unit, math.nan), computed, why)


def _divergence_row(vehicle: SimulatedVehicle, orbit: HoverOrbit) -> Row:
    """Compare the divergence rate of open-loop hover."""
    doubled = math.log(2.0) / growth(linearize(vehicle, orbit)).real
    return _unprinted("-", "hover left to itself: time to double", "s", doubled, CHOSEN)


def stroke_plane(vehicle: SimulatedVehicle, airspeed: float) -> float:
    """Compute the stroke plane in rad relative to the ground, raised at its rear, mean over a stroke of level
    flight.
    """
    orbit, stroke = hover(vehicle, airspeed), HoverMap(vehicle)
    pitch = float(np.mean(stroke.course(orbit.state, orbit.inputs)[:-1, PITCH]))
    return level_pitch(stroke.plant) - pitch


def drift_and_swing(vehicle: SimulatedVehicle) -> tuple[float, float]:
    """Compute the drift's initial downward acceleration in m/s^2, and the swing's amplitude in m/s."""
    orbit = hover(vehicle)
    frequency = SHARE / orbit.period
    sinking = open_loop(vehicle, orbit, frequency, STROKES).sink_rate
    means = stroke_means(sinking, STROKES)
    spectrum = np.abs(np.fft.rfft(_detrended(sinking[:-1])))
    return float(means[1] - means[0]) * frequency, 2.0 * float(spectrum[2 * STROKES]) / (len(sinking) - 1)


def stroke_means(values: Floats, strokes: int) -> Floats:
    """Return (strokes,) means of ``values`` at equal time steps from the first to the end of the last stroke."""
    return np.asarray(values[:-1].reshape(strokes, -1).mean(axis=1))


def _detrended(values: Floats) -> Floats:
    """Subtract a cubic in time, which is the drift over several strokes, from ``values``."""
    time = np.linspace(0.0, 1.0, len(values))
    return np.asarray(values - np.polyval(np.polyfit(time, values, 3), time))


def hover_excursion(vehicle: SimulatedVehicle, orbit: HoverOrbit, strokes: int = 100) -> float:
    """Compute the largest distance in m from the hover position after `PUSH`, with feedback once a stroke."""
    gain = position_gain(linearize(vehicle, orbit), TOLERANCES, AUTHORITY)
    course = fly(vehicle, orbit, pushed(orbit.state), gain, strokes)
    return float(np.max(np.hypot(course[:, X], course[:, Z])))


def pushed(state: Floats) -> Floats:
    """Return ``state`` after the disturbance."""
    found = state.copy()
    for index, change in PUSH.items():
        found[index] += change
    return found
