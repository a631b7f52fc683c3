"""Maneuvers of a flapping flight: found by the logged excitation, as records of stroke averages.

Outputs and inputs are averaged over exactly one measured wing period. For a linear time-invariant model averaging
commutes with the dynamics, so that the averages are an ordinary record of the same model.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from logs.identification.data.experiment import Experiment, runs
from logs.identification.data.flight import Aircraft, FlightData, JoinedFlight
from logs.identification.data.resampling import averaging_matrix, behind, cut, wing_period
from logs.identification.results import Array
from wingbeat.errors import InputError

OUTPUT_STEP = 0.01
"""s; between stroke averages"""
MIN_STROKES = 3.0
"""-; of a window: a shorter one does not show a mode slower than the flapping"""
ELEVATOR = "delta_e"
UNITS = {
    ELEVATOR: "rad", "q": "rad/s", "a_x": "m/s^2", "a_z": "m/s^2", "theta": "rad", "q_dot": "rad/s^2",
    "airspeed": "m/s",
}  # fmt: skip
"""signals of a maneuver's experiment; the elevator is the change of its command from the start"""


class Maneuver(NamedTuple):
    """One input and the response to it."""

    number: int
    """-; as the log counts"""
    experiment: Experiment
    """stroke averages of `UNITS`, `OUTPUT_STEP` apart, until the control loops resume"""
    period: float
    """s; mean wing period"""
    airspeed: float
    """m/s; mean"""
    begin: float
    """s; of the first stroke average's first sample, on the log's clock"""
    command_time: Array
    """s; (N,), of the samples that are averaged, from the first"""
    command: Array
    """rad; (N,), elevator command minus its value at the start"""
    flight: JoinedFlight | None = None
    """the one of several flights that it is from; None for a single one"""

    @property
    def name(self) -> str:
        """Number, begin and log of the maneuver."""
        return self.experiment.name


class Reference(NamedTuple):
    """Flight condition about which the model is linear: the mean over the maneuvers."""

    u: float
    """m/s; airspeed along FRD x"""
    w: float
    """m/s; airspeed along FRD z"""
    pitch: float
    """rad"""
    airspeed: float
    """m/s"""
    elevator: float = 0.0
    """rad; commanded"""


def tail_angle(time: Array, command: Array, aircraft: Aircraft) -> Array:
    """Achieved tail angle (N,) after delay and lag, of a ``command`` (N,) under zero-order hold."""
    lag = aircraft.tail_time_constant or 0.0
    return behind(command, float(time[1] - time[0]), aircraft.tail_delay, lag, zoh=True)


def find_maneuvers(data: FlightData) -> tuple[Maneuver, ...]:
    """Every complete elevator maneuver; one that repeats its input is cut before each repeat.

    Raises:
        InputError: none is usable.
    """
    windows = [one for span in maneuver_spans(data.active, data.manoeuvre, data.aborted) for one in _cut(data, span)]
    found = tuple(one for one in (_averaged(data, window) for window in windows) if one is not None)
    if not found:
        raise InputError("the log has no complete elevator maneuver flown with flapping wings")
    return found


def dropped_maneuvers(data: FlightData, maneuvers: tuple[Maneuver, ...]) -> tuple[str, ...]:
    """Why maneuvers of the log are not among the usable ``maneuvers``, one clause each."""
    used, reasons = {m.number for m in maneuvers}, []
    for number in np.unique(data.manoeuvre[data.active > 0]):
        if int(number) not in used:
            aborted = was_aborted(data.manoeuvre, data.aborted, number)
            why = "ended by an envelope limit" if aborted else "too short, or flown without flapping"
            flight = data.flight_at(float(data.time[np.argmax(data.manoeuvre == number)]))
            which = f"{int(number)}" if flight is None else f"{flight.local_number(int(number))} of {flight.name}"
            reasons.append(f"maneuver {which} left out: {why}")
    return tuple(reasons)


def reference_of(data: FlightData, maneuvers: tuple[Maneuver, ...]) -> Reference:
    """Mean flight condition over the maneuvers; the angle of attack from pitch and flight-path angle.

    Raises:
        InputError: there is no forward flight.
    """
    during = np.isin(data.manoeuvre, [m.number for m in maneuvers]) & (data.active > 0)
    airspeed, pitch = float(np.mean(data.airspeed[during])), float(np.mean(data.pitch[during]))
    if airspeed < 1.0:
        raise InputError(f"mean airspeed in the maneuvers is {airspeed:.2f} m/s: no forward flight to identify")
    climb = float(np.mean(data.climb_rate[during]))
    angle = pitch - float(np.arcsin(np.clip(climb / airspeed, -1, 1)))
    elevator = float(np.mean(data.elevator[during]))
    return Reference(airspeed * float(np.cos(angle)), airspeed * float(np.sin(angle)), pitch, airspeed, elevator)


def _cut(data: FlightData, span: slice) -> list[slice]:
    """A maneuver cut one wing period before each repeat of its input; steps closer than that are one input."""
    busy = np.flatnonzero(np.abs(data.excitation[span]) > 1e-9) + span.start
    if not len(busy):
        return []
    step = data.time[1] - data.time[0]
    strokes = max(data.strokes[span.stop - 1] - data.strokes[span.start], 1.0)
    lead = round(float((data.time[span.stop - 1] - data.time[span.start]) / strokes) / step)
    onsets = busy[np.concatenate(([True], np.diff(busy) > 3 * lead))]
    starts = [span.start, *(int(onset) - lead for onset in onsets[1:])]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], span.stop], strict=True)]


def _averaged(data: FlightData, window: slice) -> Maneuver | None:
    """Stroke averages centered in the ``window`` that end with it; None if it has too few strokes."""
    first, last = window.start, window.stop
    if data.strokes[last - 1] - data.strokes[first] < MIN_STROKES:
        return None
    step = float(data.time[1] - data.time[0])
    at = np.arange(data.time[first], data.time[last - 1], OUTPUT_STEP)
    period = wing_period(data.time, data.strokes, at)
    inside = np.isfinite(period) & (at + np.nan_to_num(period) / 2 <= data.time[last - 1])
    if inside.sum() < 2:
        return None
    rows = max(runs(inside), key=lambda one: one.stop - one.start)  # where the wings pause there is no average
    at, period = at[rows], period[rows]
    if len(at) < 2:
        return None
    begin, until = np.min(at - period / 2) - 2 * step, np.max(at + period / 2) + 2 * step
    reach = slice(int(np.searchsorted(data.time, begin)), int(np.searchsorted(data.time, until, side="right")))
    time, command = data.time[reach], data.elevator[reach]
    columns = (data.pitch_rate, data.accel_x, data.accel_z, data.pitch, np.gradient(data.pitch_rate, step),
               data.airspeed)  # fmt: skip
    averages = averaging_matrix(time, period, at) @ np.column_stack([column[reach] for column in columns])
    # A command acts from its sample on: its mean over a step is the sample, half a step later.
    elevator = averaging_matrix(time + step / 2, period, at) @ (command - command[0])
    signals = dict(zip(UNITS, np.column_stack((elevator, averages)).T, strict=True))
    number, flight = int(data.manoeuvre[first]), data.flight_at(float(data.time[first]))
    start = float(at[0] - period[0] / 2)
    name = (
        f"maneuver {number} at {start:.1f} s"
        if flight is None
        else f"maneuver {flight.local_number(number)} at {flight.local_time(start):.1f} s of {flight.name}"
    )
    return Maneuver(
        number, Experiment(name, at, signals, UNITS), float(np.mean(period)), float(np.mean(data.airspeed[reach])),
        start, time - time[0], command - command[0], flight,
    )  # fmt: skip


NEEDED = ("active", "manoeuvre", "aborted")
"""signals: 1 while a maneuver runs, its number, 1 where an envelope limit ended it"""


def excited(flight: Experiment, lead: float = 0.0, tail: float = 0.0) -> tuple[Experiment, ...]:
    """One experiment for each complete maneuver, ``lead`` s longer before and ``tail`` s behind if no other runs.

    They are named FLIGHT, maneuver NUMBER. Those that were aborted or cut by the ends of the record are left out.

    Raises:
        InputError: the flight has no signals of the excitation, or no complete maneuver.
    """
    missing = [name for name in NEEDED if name not in flight.signals]
    if missing:
        raise InputError(f"{flight.name} has no signal {', '.join(missing)} that gives its maneuvers")
    active, number, aborted = (flight.signals[name] for name in NEEDED)
    spans = [s for s in maneuver_spans(active, number, aborted) if s.start > 0 and s.stop < len(active)]
    if not spans:
        raise InputError(f"{flight.name} has no complete maneuver")
    before, behind = (int(seconds / flight.step + 1e-6) for seconds in (lead, tail))
    free = ~((active > 0) & np.isfinite(number))
    return tuple(
        cut(flight, _widened(free, span, before, behind))._replace(
            name=f"{flight.name}, maneuver {number[span.start]:.0f}"
        )
        for span in spans
    )


def maneuver_spans(active: Array, number: Array, aborted: Array) -> list[slice]:
    """Samples of each maneuver, by its ``number`` while ``active``, but those that were ``aborted``; all (N,)."""
    label = np.where((active > 0) & np.isfinite(number), number, np.nan)
    same = (label[1:] == label[:-1]) | (np.isnan(label[1:]) & np.isnan(label[:-1]))
    bounds = np.concatenate(([0], np.flatnonzero(~same) + 1, [len(label)]))
    spans = [slice(int(a), int(b)) for a, b in pairwise(bounds) if np.isfinite(label[a])]
    return [span for span in spans if not was_aborted(number, aborted, label[span.start])]


def was_aborted(number: Array, aborted: Array, one: float) -> bool:
    """Whether an envelope limit ended maneuver ``one``."""
    return bool(np.any(aborted[number == one] > 0))


def _widened(free: NDArray[np.bool_], span: slice, before: int, behind: int) -> slice:
    start, stop = span.start, span.stop
    while start > 0 and span.start - start < before and free[start - 1]:
        start -= 1
    while stop < len(free) and stop - span.stop < behind and free[stop]:
        stop += 1
    return slice(start, stop)


FRACTION = 1 / 3
"""-; held out by default"""


class FromFlight(Protocol):
    """A maneuver of one of several flights."""

    @property
    def flight(self) -> JoinedFlight | None:
        """None if there is only one."""


M = TypeVar("M", bound=FromFlight)


class Split(NamedTuple):
    """Training and validation experiments."""

    training: tuple[Experiment, ...]
    validation: tuple[Experiment, ...]
    held_out: tuple[str, ...]
    """-; names of the flights or maneuvers that are held out"""
    groups: int
    """-; flights or maneuvers"""
    kind: str
    """-; "flights" or "maneuvers" """


def split(flights: Mapping[str, Sequence[Experiment]], fraction: float = FRACTION, seed: int = 0) -> Split:
    """Hold out a ``fraction`` of the flights (at least one, not all), or of the only flight's maneuvers.

    Maneuvers of one flight share weather, trim and sensor errors, so that validation by another maneuver of the same
    flight is too favorable (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 11). The same ``seed`` and
    names give the same split in any order.

    Raises:
        InputError: the fraction is not between 0 and 1, or there is only one maneuver.
    """
    if not 0 < fraction < 1:
        raise InputError(f"a validation fraction of {fraction:g} is not between 0 and 1")
    groups = {name: tuple(experiments) for name, experiments in flights.items() if experiments}
    kind = "flights" if len(groups) > 1 else "maneuvers"
    if kind == "maneuvers":
        (every,) = groups.values()
        groups = {one.name: (one,) for one in every}
        if len(groups) < len(every):
            raise InputError("two maneuvers of the flight have the same name")
        if len(groups) < 2:
            raise InputError("a single maneuver cannot be split: record another one for validation")
    held = holdout_sample(sorted(groups), fraction, seed)
    fitted, validation = (
        tuple(one for name in sorted(groups) if (name in held) is side for one in groups[name])
        for side in (False, True)
    )
    return Split(fitted, validation, tuple(sorted(held)), len(groups), kind)


def by_flight(maneuvers: Sequence[M], validation: Collection[str]) -> tuple[tuple[M, ...], tuple[M, ...]]:
    """The maneuvers of the flights that are fitted, and those of the flights of ``validation``.

    Raises:
        InputError: a flight held out has no usable maneuver, or all are.
    """
    names = [one.flight.name if one.flight is not None else "" for one in maneuvers]
    lost = [name for name in validation if name not in names]
    if lost:
        raise InputError(f"{lost[0]} is held out and has no complete elevator maneuver with flapping wings")
    if set(names) <= set(validation):
        raise InputError("every flight with a usable maneuver is held out: none is left to fit")
    pairs = list(zip(maneuvers, names, strict=True))
    return tuple(one for one, name in pairs if name not in validation), tuple(
        one for one, name in pairs if name in validation
    )


def holdout_sample(names: list[str], fraction: float = FRACTION, seed: int = 0) -> set[str]:
    """The ``fraction`` of the names that is held out: at least one, not all."""
    count = min(max(round(fraction * len(names)), 1), len(names) - 1)
    order = np.random.default_rng(seed).permutation(len(names))
    return {names[int(index)] for index in order[:count]}
