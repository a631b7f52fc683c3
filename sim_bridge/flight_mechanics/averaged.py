"""The stroke-averaged model, linearised: x' = A x + B delta about a trimmed flapping flight.

The aircraft on its orbit is given small elevator doublets, each at several phases of the stroke; what they change is
averaged over the phases and over one stroke, which leaves the time-invariant part of the linear response. Four
states, (u, w, q, theta), then explain it to one part in a thousand, and A and B are those that do so best (the
low-order equivalent system of MIL-STD-1797). The Floquet exponents of `modes` are the exact decay rates of the
motion left to itself; the membrane's own twisting mode (15 rad/s on Robo Raven), which four states cannot hold,
moves them some 5 % from the eigenvalues of A, and it is A that a flight test with elevator inputs measures.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.orbit import Orbit
from sim_bridge.flight_mechanics.stroke_map import INTERVALS, StrokeMap
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

WIDTHS = (0.1, 0.2, 0.4)
"""s; step widths of the doublets: energy from 1 Hz to 4 Hz"""
AMPLITUDE = 0.01
"""rad; small enough for the response to be linear"""
PHASES = 8
LENGTH = 2.5
"""s; of a response"""
SKIPPED = 2
"""-; samples omitted at either end, with one-sided difference quotients"""


class AveragedModel(NamedTuple):
    """Linear longitudinal motion of the stroke averages."""

    a: Floats
    """(4, 4); of (u m/s, w m/s, q rad/s, theta rad), body axes"""
    b: Floats
    """(4,); of the achieved elevator angle in rad, nose up positive"""
    unexplained: Floats
    """(3,); fraction of the variance of u', w', q' (without gravity) that four states do not explain"""


class ShortPeriod(NamedTuple):
    """The short-period mode of an averaged model."""

    natural_frequency: float
    """rad/s; undamped"""
    damping: float
    """-; ratio"""


def stroke_averaged_model(
    vehicle: SimulatedVehicle, orbit: Orbit, on_progress: Callable[[int, int], None] = lambda done, of: None
) -> AveragedModel:
    """Linearize the stroke-averaged motion about ``orbit``; ``on_progress`` gets flights done and their number."""
    strokes = math.ceil(LENGTH * orbit.inputs.frequency)
    rest = _response(vehicle, orbit, (0.0, 0.0), strokes + 1)
    pieces = []
    for i, width in enumerate(WIDTHS):
        pieces.append(_averaged(vehicle, orbit, width, rest, strokes))
        on_progress(i + 1, len(WIDTHS))
    regressors = np.vstack([piece[0] for piece in pieces])
    rates = np.vstack([piece[1] for piece in pieces])
    values = np.linalg.lstsq(regressors, rates, rcond=None)[0]
    left = np.var(rates - regressors @ values, axis=0) / np.var(rates, axis=0)
    pitch = orbit.means.pitch
    a, b = np.zeros((4, 4)), np.zeros(4)
    a[:3, :3], b[:3] = values[:3].T, values[3]
    a[0, 3], a[1, 3], a[3, 2] = -STANDARD_GRAVITY * math.cos(pitch), -STANDARD_GRAVITY * math.sin(pitch), 1.0
    return AveragedModel(a, b, np.asarray(left, dtype=np.float64))


def state_space(model: AveragedModel) -> Any:
    """Convert the model to a python-control ``StateSpace``: input elevator, outputs all four states."""
    import control  # takes half a second, which a flight need not wait for

    return control.ss(model.a, model.b[:, None], np.eye(4), np.zeros((4, 1)))


def short_period_of(model: AveragedModel) -> ShortPeriod:
    """Compute natural frequency and damping ratio of the faster pair of eigenvalues.

    Raises:
        InputError: the faster eigenvalues are real with opposite signs, so there is no such mode.
    """
    roots = sorted(np.linalg.eigvals(model.a).astype(complex), key=abs, reverse=True)[:2]
    product, total = (roots[0] * roots[1]).real, (roots[0] + roots[1]).real
    if product <= 0.0:
        raise InputError("this flight has no short-period mode")
    return ShortPeriod(math.sqrt(product), float(-total) / (2.0 * math.sqrt(product)))


def _response(vehicle: SimulatedVehicle, orbit: Orbit, doublet: tuple[float, float], strokes: int) -> Floats:
    """Return the states (N, 5) u, w, q, theta, elevator after a doublet of (start, width) in s; width 0 for none."""
    stroke = StrokeMap(vehicle)
    stroke.unpack(orbit.state, orbit.inputs)
    step = 1.0 / (orbit.inputs.frequency * INTERVALS)
    rows = np.zeros((strokes * INTERVALS, 5))
    for i in range(len(rows)):
        controls = stroke.controls(i % INTERVALS, orbit.inputs)
        since = i * step - doublet[0]
        if 0.0 <= since < 2.0 * doublet[1]:
            side = 1.0 if since < doublet[1] else -1.0
            controls = controls._replace(elevator=orbit.inputs.elevator + side * AMPLITUDE)
        stroke.plant.advance(controls, stroke.around)
        rows[i, :4] = stroke.pack()[:4]
        place = stroke.plant.layout.elevator
        rows[i, 4] = stroke.plant.y[place] if place >= 0 else controls.elevator
    return rows


def _averaged(
    vehicle: SimulatedVehicle, orbit: Orbit, width: float, rest: Floats, strokes: int
) -> tuple[Floats, Floats]:
    """Return regressors (M, 4) u, w, q, elevator and rates (M, 3) without gravity, averaged over phase and stroke."""
    step = 1.0 / (orbit.inputs.frequency * INTERVALS)
    total = np.zeros((strokes * INTERVALS, 5))
    for phase in range(PHASES):
        late = phase * INTERVALS // PHASES
        change = _response(vehicle, orbit, (late * step, width), strokes + 1) - rest
        total += change[late : late + len(total)] / PHASES
    # Zero before an early doublet, so that the average may begin before its start.
    padded = np.vstack((np.zeros((INTERVALS, 5)), total))
    window = np.ones(INTERVALS) / INTERVALS
    mean = np.column_stack([np.convolve(column, window, "valid") for column in padded.T])
    rates = np.gradient(mean, step, axis=0)
    pitch = orbit.means.pitch
    rates[:, 0] += STANDARD_GRAVITY * math.cos(pitch) * mean[:, 3]
    rates[:, 1] += STANDARD_GRAVITY * math.sin(pitch) * mean[:, 3]
    kept = slice(SKIPPED, -SKIPPED)
    return mean[kept][:, [0, 1, 2, 4]], rates[kept, :3]
