"""Trimmed flapping flight: the orbit that repeats itself, found by shooting on the stroke map.

A trimmed flapping flight is a fixed point of the map from the start of one stroke to the start of the next. Newton's
method starts from settled wings; where that fails, the trim is followed from the vehicle's cruise in steps towards
the requested speed and climb.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sim_bridge.actuators.linkage import Motor
from sim_bridge.flight_mechanics.limits import check_model, excesses, model_warning, running_out
from sim_bridge.flight_mechanics.stroke_map import Stroke, StrokeInputs, StrokeMap, StrokeMeans
from sim_bridge.vectors import Floats
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError

FOUND, REPEATS = 1e-9, 1e-6
"""largest residual of a converged search, and of an accepted orbit"""
JACOBIANS, JACOBIANS_ON = 12, 3
"""Jacobians per search without an initial trim (one that converges takes up to 8), and from a nearby trim"""
CONTRACTION, STALL = 0.3, 0.9
"""-; residual ratio of successive steps: above the first the Jacobian is recomputed, above the second the search
stalls
"""
SPIN_UP = 12
"""-; strokes until a motor on a linkage reaches its frequency"""
FIRST_STEP, LAST_STEP = 2.0, 0.05
"""m/s of airspeed and climb; first and smallest step from the cruise. Steps are doubled and halved independent of
the request, so that the end of the flight range does not depend on it
"""

Told = Callable[[str], None]
"""called with a text on the state of the search"""


class Orbit(NamedTuple):
    """A trimmed flapping flight."""

    state: Floats
    inputs: StrokeInputs
    means: StrokeMeans
    residual: float
    """largest difference between start and end of a stroke, in the units of the state"""


class _Point(NamedTuple):
    """Unknowns with their residual."""

    x: Floats
    """state (size,), amplitude in rad or frequency in Hz, elevator in rad, throttle of a motor"""
    residual: Floats
    stroke: Stroke

    @property
    def largest(self) -> float:
        return float(np.max(np.abs(self.residual)))


class _Search:
    """Equations of a trim at one airspeed and climb rate."""

    def __init__(self, stroke: StrokeMap, airspeed: float, climb_rate: float, on_progress: Told) -> None:
        self.stroke, self.airspeed, self.climb_rate, self.on_progress = stroke, airspeed, climb_rate, on_progress

    def words(self) -> str:
        return f"{self.airspeed:.4g} m/s climbing {self.climb_rate:.3g} m/s"

    def at(self, x: Floats) -> _Point:
        size = self.stroke.size
        flown = self.stroke.fly(x[:size], inputs_of(self.stroke, x))
        requested = [flown.means.airspeed - self.airspeed, flown.means.climb_rate - self.climb_rate]
        turned = [flown.phase_error] if self.stroke.motor else []
        return _Point(x, np.concatenate((flown.end - x[:size], requested, turned)), flown)

    def jacobian(self, point: _Point) -> Floats:
        columns = []
        for i in range(len(point.x)):
            moved = point.x.copy()
            step = 1e-5 * max(1.0, abs(point.x[i]))
            moved[i] += step
            columns.append((self.at(moved).residual - point.residual) / step)
            self.on_progress(self.words())
        return np.array(columns).T

    def damped(self, point: _Point, step: Floats) -> _Point | None:
        """Return the point after a fraction of ``step`` that reduces the residual; None if there is none."""
        size = self.stroke.size
        slow = [0, 1, 3, *range(size, len(step))]
        share = min(1.0, 0.3 / max(float(np.max(np.abs(step[slow]))), 1e-12))
        for _ in range(6):
            trial = point.x + share * step
            if 0.02 < trial[size] < 200.0:
                new = self.at(trial)
                if np.all(np.isfinite(new.residual)) and _norm(new) < 1.02 * _norm(point):
                    return new
            share *= 0.5
        return None

    def newton(self, x: Floats, jacobians: int = JACOBIANS) -> _Point | None:
        """Find the fixed point by Newton's method from ``x``; None if it stalls.

        Broyden's update is used as long as it converges.
        """
        point, slope, stalled, made = self.at(x), None, 0, 0
        while np.all(np.isfinite(point.residual)) and point.largest >= FOUND:
            fresh = slope is None
            if slope is None:
                if made == jacobians or stalled == 2:
                    break
                slope, made = self.jacobian(point), made + 1
            step = np.asarray(np.linalg.lstsq(slope, -point.residual, rcond=1e-10)[0], dtype=np.float64)
            new = self.damped(point, step)
            gain = _norm(new) / _norm(point) if new is not None else 1.0
            if fresh:
                stalled = stalled + 1 if gain > STALL else 0
            slope = None if new is None or gain > CONTRACTION else _broyden(slope, point, new)
            point = new or point
            if new is None and fresh:
                break
        return point if point.largest < REPEATS else None


def _norm(point: _Point) -> float:
    return float(np.linalg.norm(point.residual))


def _broyden(slope: Floats, old: _Point, new: _Point) -> Floats:
    moved = new.x - old.x
    missed = new.residual - old.residual - slope @ moved
    return np.asarray(slope + np.outer(missed, moved) / max(float(moved @ moved), 1e-300))


def trim(
    vehicle: SimulatedVehicle, airspeed: float, climb_rate: float, on_progress: Told = lambda words: None
) -> Orbit:
    """Find elevator, drive and state of a periodic stroke at a mean speed and climb.

    The thrust control is the commanded amplitude of servo drives, the frequency of a crank, or a motor's throttle.

    Args:
        airspeed, climb_rate: m/s.
        on_progress: called with a text on the state of the search, many times a second.

    Raises:
        InputError: the aerodynamic model is not valid there, or there is no orbit within the limits of servos and
            drive; the message has the saturated control and its value.
    """
    if not airspeed > abs(climb_rate):
        raise InputError(f"an airspeed of {airspeed:g} m/s does not climb {climb_rate:g} m/s")
    check_model(vehicle, airspeed)
    return trim_stroke(StrokeMap(vehicle), airspeed, climb_rate, on_progress)


def trim_stroke(
    stroke: StrokeMap, airspeed: float, climb_rate: float, on_progress: Told = lambda words: None
) -> Orbit:
    """Compute `trim` for a stroke map, whose plant or air may differ from those of its vehicle.

    Raises:
        InputError: there is no orbit within the limits of servos and drive.
    """
    vehicle = stroke.vehicle
    requested = f"{vehicle.name}: no trim at {airspeed:g} m/s climbing {climb_rate:g} m/s"
    search = _Search(stroke, airspeed, climb_rate, on_progress)
    point = search.newton(_guess(stroke, airspeed, climb_rate)) or _continued(search, requested)
    inputs = inputs_of(stroke, point.x)
    needs = excesses(vehicle, inputs)
    if needs:
        raise InputError(f"{requested}: it needs {' and '.join(needs)}")
    return Orbit(point.x[: stroke.size], inputs, point.stroke.means, point.largest)


def inputs_of(stroke: StrokeMap, x: Floats) -> StrokeInputs:
    """Return the inputs among the unknowns: those after the state."""
    cruise, drive, elevator = stroke.vehicle.cruise, float(x[stroke.size]), float(x[stroke.size + 1])
    if stroke.motor:
        return StrokeInputs(drive, cruise.stroke_amplitude, elevator, float(x[stroke.size + 2]))
    if stroke.vehicle.drive.kind == "crank":
        return StrokeInputs(drive, cruise.stroke_amplitude, elevator)
    return StrokeInputs(cruise.frequency, drive, elevator)


def _guess(stroke: StrokeMap, airspeed: float, climb_rate: float) -> Floats:
    """Return the initial guess: some angle of attack, with settled wings."""
    vehicle, cruise = stroke.vehicle, stroke.vehicle.cruise
    inputs = StrokeInputs(cruise.frequency, cruise.stroke_amplitude, 0.0, 0.5)
    if vehicle.motor is not None and stroke.motor:
        inputs = inputs._replace(throttle=_throttle(vehicle.motor, cruise.frequency, vehicle.drive.nominal_voltage))
    z = stroke.start(inputs)
    z[0], z[1], z[3] = airspeed, 0.1 * airspeed, 0.1 + climb_rate / airspeed
    if stroke.motor:
        return _motor_guess(stroke, z, inputs)
    drive = inputs.amplitude if vehicle.drive.kind == "servo" else inputs.frequency
    return np.concatenate((stroke.settle_wings(z, inputs, 4), [drive, 0.0]))


def _motor_guess(stroke: StrokeMap, z: Floats, inputs: StrokeInputs) -> Floats:
    """Return settled wings at the throttle of about the same frequency, so that a turn ends near its start."""
    for _ in range(SPIN_UP):
        z = stroke.settle_wings(z, inputs, 1)
        wanted = inputs.throttle * inputs.frequency / max(float(z[stroke.crank]), 0.5 * inputs.frequency)
        inputs = inputs._replace(throttle=min(wanted, 1.0))
    return np.concatenate((z, [inputs.frequency, 0.0, inputs.throttle]))


def _throttle(motor: Motor, frequency: float, voltage: float) -> float:
    """Return the throttle at which a motor turns the crank at ``frequency`` Hz with a quarter of its voltage for the
    load.
    """
    back_emf = motor.torque_constant * motor.gear_ratio * 2.0 * np.pi * frequency
    return float(min(back_emf / (0.75 * voltage), 1.0))


def _continued(requested: _Search, refusal: str) -> _Point:
    """Follow the trim from the vehicle's cruise.

    Raises:
        InputError: it ends, or exceeds the limits of the vehicle, on the way.
    """
    stroke, cruise = requested.stroke, requested.stroke.vehicle.cruise
    start = _Search(stroke, cruise.airspeed, cruise.climb_rate, requested.on_progress)
    last = start.newton(_guess(stroke, cruise.airspeed, cruise.climb_rate))
    if last is None:
        warning = model_warning(stroke.vehicle)
        raise InputError(f"{refusal}, nor at its cruise, {start.words()}{warning and f'; {warning}'}")
    way = abs(requested.airspeed - cruise.airspeed) + abs(requested.climb_rate - cruise.climb_rate)
    done, step, failed, slope = 0.0, FIRST_STEP, False, np.zeros_like(last.x)
    slope[:2] = last.x[:2] * (requested.airspeed / cruise.airspeed - 1.0) / max(way, LAST_STEP)
    reached = start
    while done < way:
        ahead = min(done + step, way)
        there = _Search(stroke, *_between(start, requested, ahead / way), requested.on_progress)
        found = there.newton(last.x + (ahead - done) * slope, JACOBIANS_ON)
        if found is None:
            step, failed = _shorter(step, way - done), True
            if step < LAST_STEP:
                now, ahead_of_it = (inputs_of(stroke, x) for x in (last.x, last.x + LAST_STEP * slope))
                raise InputError(
                    f"{refusal}: {_beyond(reached, requested)} {running_out(stroke.vehicle, now, ahead_of_it)}"
                )
            continue
        needs = excesses(stroke.vehicle, inputs_of(stroke, found.x))
        if needs and ahead < way:
            raise InputError(f"{refusal}: already at {there.words()} it needs {' and '.join(needs)}")
        slope = (found.x - last.x) / (ahead - done)
        last, done, reached = found, ahead, there
        step, failed = step if failed else 2.0 * step, False
    return last


def _shorter(step: float, rest: float) -> float:
    """Halve a failed step until it ends before the ``rest`` of the way."""
    step *= 0.5
    return step if step < rest else _shorter(step, rest)


def _beyond(reached: _Search, requested: _Search) -> str:
    if reached.climb_rate == requested.climb_rate:
        return f"{'below' if requested.airspeed < reached.airspeed else 'above'} {reached.airspeed:.3g} m/s"
    return f"beyond {reached.words()}"


def _between(start: _Search, end: _Search, share: float) -> tuple[float, float]:
    return (
        start.airspeed + share * (end.airspeed - start.airspeed),
        start.climb_rate + share * (end.climb_rate - start.climb_rate),
    )
