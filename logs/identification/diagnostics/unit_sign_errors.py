"""Which known mistake of a table makes the changes of a flow angle those that rates and specific forces add up to.

V alpha' = V q + a_z + g cos(theta) cos(phi) and V beta' = a_y + g cos(theta) sin(phi) + V (p sin(alpha) - r
cos(alpha)), of small flow angles (Klein & Morelli, Aircraft System Identification, 2006, ch. 3 and 10). A factor on
one of the terms, as of a speed in knots or a force with its sign turned, is told by how much less it leaves
unexplained than the table as it stands does. Scales of vanes, their places and what sensors are off by are free.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import lsq_linear

from logs.identification.data.contiguous_runs import longest_run
from logs.identification.data.experiment import Experiment
from logs.identification.data.noise_level import noise_beside_steps
from logs.identification.estimators.flight_path.sensors import SPEEDS
from logs.identification.results import Array
from wingbeat.constants import STANDARD_GRAVITY

DEGREES = float(np.degrees(1.0))
VANE = (0.5, 2.0)
"""-; what the scale of a flow angle may be"""
LEAST_EXPLAINED = 0.7
"""-; of the angle's changes, with the mistake mended: below it nothing is concluded"""
BETTER = 4.0
"""-; by how much less the mended table leaves, beside the angle's own noise"""
THIRD = 0.2
"""-; of what it leaves less, on the mean of the thirds of the motion, each of them must have: what noise adds up to
over a record can stand for a mistake, but is another one in another third"""
SENSOR = 1.15
"""-; factor within which a rate, a force, a bank or an airspeed may be off without being mistaken"""
EXACT = 1.0 + 1e-6
SHARE = 1.3
"""-; factor within which a mended term comes out as the others do"""
ALIKE = 1.5
"""-; times the least that is left: units that leave no more are named with the likeliest"""
NOISE_KNOWN = 0.1
"""-; what the power of the angle's noise is known to"""
LEAST_RUN = 20
"""-; samples on end in which all was measured"""
THIRDS = 3
WALK = 15.0
"""-; a random walk of N steps without its mean and slope has N / 15 of a step's variance, on the mean"""

Terms = Callable[[Mapping[str, Array]], dict[str, Array]]


class Known(NamedTuple):
    """A mistake that tables have."""

    words: str
    """what is said of it; of a speed's unit, up to the units"""
    factors: Mapping[str, float]
    """-; by term, what mends it"""
    units: tuple[str, str] = ("", "")
    """what the speed is in, and what it is called"""


class Flow(NamedTuple):
    """A flow angle and what changes it."""

    angle: str
    needed: tuple[str, ...]
    """signals or constants without which nothing is asked"""
    usual: Mapping[str, float]
    """signals or constants that count so where they are not told"""
    terms: Terms
    """rad/s; the parts of its rate by name, (N,) each"""
    places: tuple[str, ...]
    """rates that a vane off the centre of mass adds to the angle"""
    mistakes: tuple[Known, ...]


def _normal(of: Mapping[str, Array]) -> dict[str, Array]:
    down = of["a_z"] + STANDARD_GRAVITY * np.cos(of["theta"]) * np.cos(of["phi"])
    return {"turning": of["q"], "pushed": down / of["V"]}


def _sideways(of: Mapping[str, Array]) -> dict[str, Array]:
    return {
        "pushed": of["a_y"] / of["V"],
        "weight": STANDARD_GRAVITY * np.cos(of["theta"]) * np.sin(of["phi"]) / of["V"],
        "rolling": of["p"] * np.sin(of["alpha"]),
        "turning": -of["r"] * np.cos(of["alpha"]),
    }


def _of_speed(rest: str, terms: tuple[str, ...]) -> tuple[Known, ...]:
    """The units that an airspeed may be in and not be called by."""
    words = f"V does not fit {rest}: is it in"
    return tuple(
        Known(words, dict.fromkeys(terms, factor), units)
        for unit, larger in SPEEDS.items()
        for units, factor in (((unit, "m/s"), larger), (("m/s", unit), 1.0 / larger))
    )


HINT = "body axes are x forward, y right, z down"
NORMAL = Flow(
    "alpha", ("q", "a_z", "V"), {"theta": 0.0, "phi": 0.0}, _normal, ("q",),
    _of_speed("alpha, q and a_z", ("pushed",)),
)  # fmt: skip
SIDEWAYS = Flow(
    "beta", ("p", "r", "phi", "a_y", "V"), {"theta": 0.0, "alpha": 0.0}, _sideways, ("r", "p"),
    (
        Known(f"a_y is against the changes of beta: its sign is wrong ({HINT})", {"pushed": -1.0}),
        Known("a_y does not fit the changes of beta: it is in g, not in m/s^2", {"pushed": STANDARD_GRAVITY}),
        Known("a_y does not fit the changes of beta: it is in m/s^2, not in g", {"pushed": 1.0 / STANDARD_GRAVITY}),
        Known(f"r is against the changes of beta: its sign is wrong ({HINT})", {"turning": -1.0}),
        Known("r does not fit the changes of beta: it is in rad/s, not in deg/s", {"turning": DEGREES}),
        Known("r does not fit the changes of beta: it is in deg/s, not in rad/s", {"turning": 1.0 / DEGREES}),
        Known(
            f"beta changes against p, r, phi and a_y: its sign is wrong ({HINT})",
            {"pushed": -1.0, "weight": -1.0, "rolling": -1.0, "turning": -1.0},
        ),
        *_of_speed("beta, r, phi and a_y", ("pushed", "weight")),
    ),
)  # fmt: skip


class _Piece(NamedTuple):
    """A run of one manoeuvre in which all was measured, each column without its mean and slope."""

    angle: Array
    """rad; (N,)"""
    terms: dict[str, Array]
    """rad; (N,) each, integrals"""
    beside: Array
    """rad/s; (N, k), the rates of `Flow.places`"""
    drift: float
    """rad^2; squares that white noise of the terms' rates adds up to"""
    noise: float
    """rad^2; squares of the angle's own white noise"""


def mistake(flow: Flow, experiments: Sequence[Experiment], constants: Mapping[str, float]) -> str:
    """What is wrong with the table, by all manoeuvres or by one of them; empty where nothing is known to be."""
    pieces = [piece for one in experiments for piece in _pieces(flow, one, constants)]
    together = [pieces] if pieces else []
    for some in together + [[piece] for piece in pieces if len(pieces) > 1]:
        said = _mistake_of(flow, some)
        if said:
            return said
    return ""


def _mistake_of(flow: Flow, pieces: list[_Piece]) -> str:
    as_told = _left(pieces, {}, mended=False)
    if as_told is None:
        return ""
    power = np.concatenate([piece.angle**2 for piece in pieces])
    thirds = np.minimum((THIRDS * np.cumsum(power) / power.sum()).astype(int), THIRDS - 1)
    noise, drift = sum(piece.noise for piece in pieces), sum(piece.drift for piece in pieces)
    motion, left = float(power.sum()) - noise, float(as_told.sum()) - noise
    least = min((1.0 - LEAST_EXPLAINED) * motion, left / BETTER - drift)
    found: list[tuple[float, Known]] = []
    for known in flow.mistakes:
        mended = _left(pieces, known.factors, mended=True)
        if mended is None or not _borne_out(pieces, known.factors):
            continue
        rest = max(float(mended.sum()) - noise, NOISE_KNOWN * noise)
        each = [float(np.sum((as_told - mended)[thirds == k])) for k in range(THIRDS)]
        if rest < least and min(each) > THIRD * sum(each) / THIRDS:
            exactly = _left(pieces, known.factors, mended=True, sensor=EXACT)
            found.append((np.inf if exactly is None else float(exactly.sum()), known))
    return said_of(found) if found else ""


def said_of(found: list[tuple[float, Known]]) -> str:
    """What the mistake is that leaves least, with exact sensors; of speeds with those that leave hardly more."""
    least, best = min(found, key=lambda one: one[0])
    if not best.units[0]:
        return best.words
    alike = [known.units for rest, known in found if rest <= ALIKE * least and known.words == best.words]
    is_in, told = (" or ".join(dict.fromkeys(units)) for units in zip(*alike, strict=True))
    return f"{best.words} {is_in}, not in {told}, or is their scale wrong?"


def _borne_out(pieces: list[_Piece], factors: Mapping[str, float]) -> bool:
    """Whether the terms that are mended come out as they should beside the others, where each sum's size is free.

    A term that is noise, or all but balanced by another, fits the better the smaller it is made.
    """
    if all(name in factors for name in pieces[0].terms) or all(abs(one) >= 1.0 for one in factors.values()):
        return True
    sums = [
        np.concatenate([np.sum([factors[n] * one.terms[n] for n in factors], axis=0) for one in pieces]),
        np.concatenate([np.sum([t for n, t in one.terms.items() if n not in factors], axis=0) for one in pieces]),
    ]
    angle, beside = np.concatenate([one.angle for one in pieces]), np.vstack([one.beside for one in pieces])
    mended, others = np.linalg.lstsq(np.column_stack((*sums, beside)), angle, rcond=None)[0][:2]
    return bool(others > 0 and 1.0 / SHARE < mended / others < SHARE)


def _left(pieces: list[_Piece], factors: Mapping[str, float], mended: bool, sensor: float = SENSOR) -> Array | None:
    """Squares (N,) that the terms leave of the angle, each term times its factor; None where nothing moves.

    The sum's scale is a vane's, and each term's may be off by ``sensor`` beside it. None too where a ``mended`` table
    asks for another scale.
    """
    terms = np.column_stack(
        [np.concatenate([factors.get(n, 1.0) * one.terms[n] for one in pieces]) for n in pieces[0].terms]
    )
    angle, beside = np.concatenate([one.angle for one in pieces]), np.vstack([one.beside for one in pieces])
    design = np.column_stack((terms.sum(axis=1), beside))
    if not np.all(np.ptp(design, axis=0) > 0) or not np.ptp(angle) > 0:
        return None
    scale = float(np.linalg.lstsq(design, angle, rcond=None)[0][0])
    if mended and not VANE[0] < scale < VANE[1]:
        return None
    scale = float(np.clip(scale, *VANE))
    free = np.full(beside.shape[1], np.inf)
    low = np.concatenate((np.full(terms.shape[1], scale / sensor), -free))
    high = np.concatenate((np.full(terms.shape[1], scale * sensor), free))
    size = np.linalg.norm(whole := np.column_stack((terms, beside)), axis=0)
    size[~(size > 0)] = 1.0
    found = lsq_linear(whole / size, angle, (low * size, high * size)).x / size
    return np.asarray((angle - whole @ found) ** 2)


def _pieces(flow: Flow, one: Experiment, constants: Mapping[str, float]) -> list[_Piece]:
    """The longest run of a manoeuvre with all that the flow angle asks for; none where it is not told."""
    columns: dict[str, Array] = {}
    for name in (flow.angle, *flow.needed, *flow.usual):
        called = "airspeed" if name == "V" and name not in one.signals else name
        if called in one.signals:
            columns[name] = np.asarray(one.signals[called], dtype=np.float64)
        elif name == flow.angle or not (name in constants or name in flow.usual):
            return []
        else:
            columns[name] = np.full(len(one.time), constants.get(name, flow.usual.get(name, 0.0)))
    known = np.all(np.isfinite(np.column_stack(list(columns.values()))), axis=1) & (columns["V"] > 0)
    there = longest_run(known)
    length = there.stop - there.start
    if length < LEAST_RUN:
        return []
    run = {name: values[there] for name, values in columns.items()}
    rates = flow.terms(run)
    terms = {name: level(_summed(rate, one.step)) for name, rate in rates.items()}
    beside = np.column_stack([level(run[name]) for name in flow.places])
    walked = sum((noise_beside_steps(rate) * one.step) ** 2 for rate in rates.values())
    angle = np.unwrap(run[flow.angle])
    noise = length * noise_beside_steps(angle) ** 2
    return [_Piece(level(angle), terms, beside, length**2 * walked / WALK, noise)]


def _summed(rate: Array, step: float) -> Array:
    return np.concatenate(([0.0], np.cumsum((rate[1:] + rate[:-1]) / 2.0 * step)))


def level(columns: Array) -> Array:
    """``columns`` (N,) or (N, k) without their mean and slope."""
    line = np.vander(np.linspace(-1.0, 1.0, len(columns)), 2)
    flat: Array = columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0]
    return flat
