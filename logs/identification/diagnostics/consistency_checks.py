"""Signals of a table that contradict one another: another sign than body axes have, degrees or g taken for SI.

A fit follows such signals as well as right ones and is sure of its wrong numbers. The kinematics tell: what gravity
leaves in a_z, and that angles are what the rates add up to (Klein & Morelli, Aircraft System Identification, 2006,
ch. 10: data compatibility). Only what a known mistake explains is refused; any other factor may be a sensor's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from logs.identification.data.contiguous_runs import longest_run
from logs.identification.data.experiment import Experiment
from logs.identification.diagnostics.unit_sign_errors import DEGREES, HINT, NORMAL, SIDEWAYS, level, mistake
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.errors import InputError

UPRIGHT = (0.7, 1.4)
"""-; mean of a_z over g, of which a flight's is -1 and an a_z that counts upward's +1"""
LEAST_EXPLAINED = 0.9
"""-; of an angle, by what the rates add up to: below it nothing is concluded"""
LEAST_MEAN = 0.5
"""m/s^2; mean specific force along an axis, from which on an accelerometer's bias does not turn its sign"""
SPEEDS = ("V", "airspeed")
SPEED_UNITS, UNIT_WITHIN = (1.944, 2.237, 3.281, 3.6), 1.1
"""-; knots, miles per hour, feet per second and km/h in a m/s, and how near to one a mistake of units comes"""
STANDING = 0.1
"""-; of the steady airspeed, below which none was measured"""
NEAR = 1.3
"""-; factor within which a known mistake explains another one"""
WIDEST_TRAVEL = math.pi
"""rad; of an input's angle from one end to the other in all manoeuvres: wings flap through two thirds of it"""
ENDS = (0.5, 99.5)
"""%; of the samples between which an input moves: a spike is no travel"""
LEAST_RUN = 20
"""-; samples on end in which all was measured"""
ANGLE_RATES = (("theta", "q"), ("phi", "p"))


class Mistake(NamedTuple):
    """What explains that signals contradict one another."""

    kind: str
    """-; which of the known ones"""
    words: str
    """-; one line for people"""


Find = Callable[[Array], Mistake | None]
"""the factors of `_shares` -> a known mistake that explains them"""


def check_plausible(
    experiments: Sequence[Experiment], constants: Mapping[str, float], inputs: Sequence[str] = ()
) -> None:
    """Refuse signals that cannot all be what the map calls them.

    Raises:
        InputError: one of ``inputs``, which the map calls radians, moves as only degrees do;
            a_z is positive on the mean as one that counts
            upward is; an angle changes against the rates, or 57 or a thousand times as fast or as slowly as they say;
            a_z is against alpha and q, or in g; a_x or a_y is against what the speed along its axis and gravity
            say, or in g; or the airspeed is in another unit than it is called by, or ``constants`` have
            it in another one.
    """
    _check_inputs(experiments, inputs)
    _check_gravity(experiments)
    _check_speed(experiments, constants)
    for angle, rate in ANGLE_RATES:
        shares = _shares(experiments, angle, (rate,), constants)
        wrong = None if shares is None else _turning(shares, angle, rate)
        if wrong:
            raise InputError(wrong.words)
    _check_lift(experiments, constants)
    for flow in (NORMAL, SIDEWAYS):
        said = mistake(flow, experiments, constants)
        if said:
            raise InputError(said)
    for force, (names, speed_and_rest) in ALONG.items():
        share = _force_share(experiments, force, names, speed_and_rest)
        if share is not None:
            _check_along(share, force)


def _check_speed(experiments: Sequence[Experiment], constants: Mapping[str, float]) -> None:
    """Refuse an airspeed of the steady flight that is the measured one in another unit: lift goes by its square.

    A pitot that was blocked for a while, spikes and a speed that counts from the steady one say nothing of units.
    """
    told = constants.get("V", 0.0)
    measured = [np.asarray(one.signals[name]) for one in experiments for name in SPEEDS if name in one.signals]
    flown = np.concatenate(measured) if measured else np.zeros(0)
    moving = flown[np.isfinite(flown) & (flown > STANDING * told)]
    if not told > 0.0 or not len(moving) > np.count_nonzero(np.isfinite(flown)) / 2:
        return
    usual = float(np.median(moving))
    ratio = max(told / usual, usual / told)
    if any(unit / UNIT_WITHIN < ratio < unit * UNIT_WITHIN for unit in SPEED_UNITS):
        raise InputError(
            f"constants.V is {told:.4g} m/s and signals.V {usual:.4g} m/s: one of both is in another unit than told"
        )


def _forward(of: Mapping[str, Array]) -> tuple[Array, Array]:
    """``u``, and what of its slope a_x does not make."""
    down = of["V"] * np.sin(of["alpha"])
    return of["V"] * np.cos(of["alpha"]), -STANDARD_GRAVITY * np.sin(of["theta"]) - of["q"] * down


def _sideways(of: Mapping[str, Array]) -> tuple[Array, Array]:
    """``v``, and what of its slope a_y does not make."""
    level = of["V"] * np.cos(of["beta"])
    turning = of["p"] * level * np.sin(of["alpha"]) - of["r"] * level * np.cos(of["alpha"])
    return of["V"] * np.sin(of["beta"]), STANDARD_GRAVITY * np.cos(of["theta"]) * np.sin(of["phi"]) + turning


Along = Callable[[Mapping[str, Array]], tuple[Array, Array]]
ALONG: dict[str, tuple[tuple[str, ...], Along]] = {
    "a_x": (("V", "alpha", "theta", "q"), _forward),
    "a_y": (("V", "alpha", "beta", "phi", "theta", "p", "r"), _sideways),
}
"""by specific force: the signals that tell the motion along its axis, and how"""


def _force_share(experiments: Sequence[Experiment], force: str, names: tuple[str, ...], along: Along) -> float | None:
    """By what factor the speed along an axis follows the integral of a specific force; None where it does not.

    A line of each record stands for the accelerometer's bias and the start. Where that leaves too little, the mean
    force tells the sign, if it should be more than any bias.
    """
    given, made, means = [], [], []
    for one in experiments:
        if not {force, *names} <= set(one.signals):
            continue
        columns = {name: np.asarray(one.signals[name]) for name in (force, *names)}
        there = longest_run(np.all(np.isfinite(np.column_stack(list(columns.values()))), axis=1))
        if there.stop - there.start < LEAST_RUN:
            continue
        speed, rest = along({name: values[there] for name, values in columns.items()})
        both = np.column_stack((columns[force][there], rest))
        summed = np.vstack((np.zeros(2), np.cumsum((both[1:] + both[:-1]) / 2.0 * one.step, axis=0)))
        change = speed - summed[:, 1]
        means.append((summed[-1, 0], change[-1] - change[0], (len(summed) - 1) * one.step))
        flat = level(np.column_stack((summed[:, 0], change)))
        given.append(flat[:, 0])
        made.append(flat[:, 1])
    if not given or not np.ptp(np.concatenate(given)) > 0 or not np.ptp(np.concatenate(made)) > 0:
        return None
    x, y = np.concatenate(given), np.concatenate(made)
    share = float(x @ y / (x @ x))
    explained = 1.0 - float(np.sum((y - share * x) ** 2) / np.sum(y**2))
    if explained >= LEAST_EXPLAINED:
        return share
    felt, should, lasted = np.sum(means, axis=0)
    return float(should / felt) if abs(should) > LEAST_MEAN * lasted and should * felt < 0 else None


def _check_along(share: float, force: str) -> None:
    """``share`` is how much of a speed's change the ``force`` makes over what it should."""
    if _is(share, -1.0):
        raise InputError(
            f"{force} is against what airspeed, flow angles and attitude say: its sign is wrong ({HINT})"
        )
    for factor, unit in ((STANDARD_GRAVITY, "in g, not in m/s^2"), (1.0 / STANDARD_GRAVITY, "in m/s^2, not in g")):
        if _is(share, factor):
            raise InputError(f"{force} does not fit airspeed, flow angles and attitude: it is {unit}")


def _check_inputs(experiments: Sequence[Experiment], inputs: Sequence[str]) -> None:
    for name in inputs:
        angles = [np.asarray(one.signals[name]) for one in experiments if name in one.signals]
        known = np.concatenate([one[np.isfinite(one)] for one in angles]) if angles else np.zeros(0)
        travel = float(np.ptp(np.percentile(known, ENDS))) if len(known) else 0.0
        if travel > WIDEST_TRAVEL:
            raise InputError(
                f"signals.{name} moves through {math.degrees(travel):.0f} deg: is it in deg, not in rad?"
            )


def _check_gravity(experiments: Sequence[Experiment]) -> None:
    values = [one.signals["a_z"] for one in experiments if "a_z" in one.signals]
    measured = np.concatenate([one[np.isfinite(one)] for one in values]) if values else np.zeros(0)
    if not len(measured):
        return
    mean = float(measured.mean())
    if UPRIGHT[0] < mean / STANDARD_GRAVITY < UPRIGHT[1]:
        raise InputError(
            f"signals.a_z is {mean:+.1f} m/s^2 on the mean where a flight has -9.8 ({HINT}): scale = -1.0 is missing"
        )
    if UPRIGHT[0] < abs(mean) / STANDARD_GRAVITY**2 < UPRIGHT[1]:
        raise InputError(f"signals.a_z is {mean:.3g} m/s^2 on the mean: it is in m/s^2 already, not in g")


def _check_lift(experiments: Sequence[Experiment], constants: Mapping[str, float]) -> None:
    """Refuse what alpha, q and a_z say by all that was measured, and by each third of alpha's motion as well.

    What noise adds up to over a record can stand for a mistake: of motions that fade slowly 15 to 22 % were refused.
    It is another one in another third. A third that tells nothing does not contradict.

    Raises:
        InputError: they do.
    """
    whole = _shares(experiments, "alpha", ("q", "a_z"), constants)
    if whole is None:
        return
    for find in (_turning, _lift):
        wrong = find(whole)
        if wrong is None:
            continue
        thirds = (_shares(experiments, "alpha", ("q", "a_z"), constants, third) for third in range(3))
        if all(shares is None or _is_of(wrong.kind, find(shares)) for shares in thirds):
            raise InputError(wrong.words)


def _is_of(kind: str, found: Mistake | None) -> bool:
    return found is not None and found.kind == kind


def _turning(shares: Array, angle: str = "alpha", rate: str = "q") -> Mistake | None:
    """The first of ``shares`` is how fast the angle changes over what the rate says."""
    share = float(shares[0])
    if _is(share, -1.0):
        return _said(f"{angle} changes against {rate}: the sign of one of them is wrong ({HINT})")
    for factor, fast in ((DEGREES, "as fast"), (1.0 / DEGREES, "as slowly")):
        if _is(share, factor):
            return _said(f"{angle} changes 57 times {fast} as {rate} says: the unit of one of them is wrong")
    for power in (3, 6, 9):
        for factor, fast in ((10.0**power, "as fast"), (10.0**-power, "as slowly")):
            if _is(share, factor):
                return _said(f"{angle} changes 1e{power} times {fast} as {rate} says: time.unit (or rate) is wrong")
    return None


def _lift(shares: Array) -> Mistake | None:
    """The second of ``shares`` is how much of alpha's change a_z makes over what it should."""
    share = float(shares[1])
    if _is(share, -1.0):
        return _said(f"a_z is against the changes of alpha and q: its sign is wrong ({HINT}; scale = -1.0)")
    for factor, unit in ((STANDARD_GRAVITY, "in g, not in m/s^2"), (1.0 / STANDARD_GRAVITY, "in m/s^2, not in g")):
        if _is(share, factor):
            return _said(f"a_z does not fit the changes of alpha and q: it is {unit}, or V is wrong")
    for factor, units in ((DEGREES, "deg, not in rad"), (1.0 / DEGREES, "rad, not in deg")):
        if _is(share, factor):
            return _said(f"alpha and q do not fit a_z and V: both are in {units}, or the unit of a_z or V is wrong")
    return None


def _said(words: str) -> Mistake:
    """A mistake that its words tell from all others."""
    return Mistake(words, words)


def _is(share: float, factor: float) -> bool:
    return share / factor > 0 and abs(math.log(share / factor)) < math.log(NEAR)


def _shares(
    experiments: Sequence[Experiment],
    angle: str,
    rates: tuple[str, ...],
    constants: Mapping[str, float],
    third: int | None = None,
) -> Array | None:
    """By what factor the angle follows the integral of each of ``rates``; None where it follows none, or lacks one.

    A line of each record stands for biases and start, the last rate's own value for an accelerometer off the centre.
    ``third`` is that of the angle's motion in each record, 0 to 2, all of it where None.
    """
    names = (angle, *rates)
    known = [one for one in experiments if set(names) <= set(one.signals)]
    pieces = [piece for one in known for piece in _run(one, names, constants, third)]
    if not pieces:
        return None
    design, response = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
    if not np.all(np.ptp(design, axis=0) > 0) or not np.ptp(response) > 0:
        return None
    values = np.linalg.lstsq(design, response, rcond=None)[0]
    left = float(np.sum((response - design @ values) ** 2) / np.sum(response**2))
    return values[: len(rates)] if 1.0 - left >= LEAST_EXPLAINED else None


def _run(
    one: Experiment, names: tuple[str, ...], constants: Mapping[str, float], third: int | None
) -> list[tuple[Array, Array]]:
    """Integrals of the rates and, beside them, the pitch rate; the angle; each without its line."""
    columns = np.column_stack([one.signals[name] for name in names])
    speed = _speed(one, constants)
    if "a_z" in names and speed is None:
        return []
    columns = columns[longest_run(np.all(np.isfinite(columns), axis=1))]
    if len(columns) < LEAST_RUN:
        return []
    columns[:, 0] = np.unwrap(columns[:, 0])
    if third is not None:
        power = np.cumsum(level(columns[:, :1])[:, 0] ** 2)
        first, last = np.searchsorted(power, power[-1] * np.array([third, third + 1]) / 3.0)
        columns = columns[first:last]
        if len(columns) < LEAST_RUN:
            return []
    rates = columns[:, 1:] / np.array([speed if name == "a_z" else 1.0 for name in names[1:]])
    gained = (rates[1:] + rates[:-1]) / 2.0 * one.step
    summed = np.vstack((np.zeros(gained.shape[1]), np.cumsum(gained, axis=0)))
    beside = columns[:, 1:2] if "a_z" in names else np.zeros((len(columns), 0))
    return [(level(np.hstack((summed, beside))), level(columns[:, :1])[:, 0])]


def _speed(one: Experiment, constants: Mapping[str, float]) -> float | None:
    """Mean airspeed in m/s; None where neither a signal nor the constants tell it."""
    told = next((one.signals[name] for name in SPEEDS if name in one.signals), np.zeros(0))
    speed = float(np.nanmean(told)) if np.any(np.isfinite(told)) else constants.get("V", 0.0)
    return speed if speed > 0 else None
