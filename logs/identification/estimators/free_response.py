"""Free motion after an input, or without one: damped sinusoids with an offset and a slow drift.

Nonlinear least squares on the ring-down (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 3; the
logarithmic decrement as in Etkin & Reid, Dynamics of Flight, 1996). All outputs and records share the frequency
and the damping; amplitudes, phases, offsets and drifts are each one's own.
"""

from __future__ import annotations

import math

import numpy as np

from logs.identification.estimators.records import LEAST_SAMPLES, Record, Records
from logs.identification.estimators.variable_projection import Build, Piece, SeparableFit, solve, squares
from logs.identification.models.modes import HEAVY, SHORT_PERIOD, Mode, nothing, paired_mode, without_heavy
from logs.identification.results import Array
from logs.identification.statistics.parameter_uncertainty import (
    coloured_spread,
    determined,
    information,
    scores_of,
    with_scatter,
)

METHOD = "free response"
DRIFT_ORDER, FINER_DRIFT = 2, 4
"""-; of the polynomial that stands for slow motion. What the finer one moves counts as an error: of 100 flights of a
lightly damped aircraft with a phugoid of a fifth of its frequency 87 frequencies were held without, 97 with it"""
GRID = 24
DAMPINGS = (0.05, 0.3, 0.8)
SLOWER = (0.08, 0.2, 0.4)
"""-; of the short period's frequency: where the phugoid is looked for"""
LEAST_EXPLAINED = 0.8
"""-; of the power about the drift"""
LEAST_TURN = 2.0
"""-; periods that the ring-down must span: gusts ring the aircraft as well, and fit as lightly damped ones in less"""
LARGEST_DAMPING = 0.4
"""-; a quarter of a cycle to half amplitude. Above, the drift took the phugoid for damping: at 0.6 3 % too little"""


def free_response(records: Records, kinds: tuple[str, ...] = (SHORT_PERIOD,)) -> Mode:
    """Modes ``kinds`` from what follows the input of each record, or from the whole record where there is none."""
    rings = ring_downs(records)
    if not rings:
        return nothing(METHOD, "the input does not rest long enough for a free motion to be seen", kinds)
    fit = fit_ring_downs(rings, len(kinds))
    why = fit.failure or _doubt(fit, rings)
    if why:
        return nothing(METHOD, why, kinds)
    return _mode(fit, rings, records, kinds)


def ring_downs(records: Records) -> tuple[Record, ...]:
    """What is left of each record after its input has come to rest and been averaged away."""
    found = []
    for piece in records.pieces:
        first = piece.free_from + (0 if piece.free_from == 0 else 1)
        rest = piece.outputs[first:]
        if len(rest) >= LEAST_SAMPLES:
            found.append(piece._replace(input=None, outputs=rest - rest.mean(axis=0), free_from=0))
    return tuple(found)


def fit_ring_downs(rings: tuple[Record, ...], count: int) -> SeparableFit:
    """``count`` pairs of frequency (rad/s) and damping ratio, from the best of a grid and the decrement's."""
    build = builder(rings)
    longest = max(len(ring.outputs) * ring.step for ring in rings)
    highest = min(0.25 * math.pi / ring.step for ring in rings)
    lowest = min(math.pi / longest, highest / 2)
    starts = [np.array([w, z]) for w in np.geomspace(lowest, highest, GRID) for z in DAMPINGS]
    decrement = log_decrement(rings[0].outputs[:, 0], rings[0].step)
    starts += [] if decrement is None else [np.array(decrement)]
    best = min(starts, key=lambda start: squares(build, start))
    if count == 1:
        return solve(build, best)
    pairs = [np.concatenate((best, [best[0] * share, 0.1])) for share in SLOWER]
    pairs += [np.concatenate(([best[0] / share, 0.4], best)) for share in SLOWER]
    return solve(build, min(pairs, key=lambda start: squares(build, start)))


def builder(rings: tuple[Record, ...], order: int = DRIFT_ORDER) -> Build:
    """What makes the linear problem of given frequencies and dampings (2 k,), with a drift of the ``order``."""
    spans = {(len(ring.outputs), ring.step) for ring in rings}

    def build(values: Array) -> list[Piece]:
        own = {span: _columns(values, *span, order) for span in spans}
        pieces = []
        for ring in rings:
            outputs = ring.outputs.shape[1]
            columns = own[len(ring.outputs), ring.step]
            pieces.append(Piece(ring.outputs, (columns,) * outputs, (columns[:, :0],) * outputs))
        return pieces

    return build


def _columns(values: Array, samples: int, step: float, order: int) -> Array:
    """The waves of each pair of ``values`` (2 k,), an offset and a drift of the ``order``: (N, 2 k + 1 + order)."""
    time = np.linspace(0.0, (samples - 1) * step, samples)
    waves = [wave for w, z in values.reshape(-1, 2).tolist() for wave in damped(time, w, z)]
    return np.column_stack((*waves, np.vander(2 * time / time[-1] - 1, order + 1)))


def damped(time: Array, frequency: float, damping: float) -> tuple[Array, Array]:
    """The two solutions (N,) of ``y'' + 2 zeta omega y' + omega^2 y = 0``, smooth through a damping of 1."""
    root = np.sqrt(complex(damping**2 - 1)) * frequency
    root = root if abs(root) > 1e-9 * abs(frequency) else complex(1e-9 * abs(frequency))
    exponent = np.clip(-damping * frequency * time, -300.0, 300.0)
    up, down = (np.exp(np.clip((exponent + sign * root * time).real, -300, 300) + 1j * (sign * root * time).imag)
                for sign in (1, -1))  # fmt: skip
    return ((up + down) / 2).real, ((up - down) / (2 * root)).real


def log_decrement(values: Array, step: float) -> tuple[float, float] | None:
    """Frequency (rad/s) and damping ratio of ``values`` (N,) by its extrema (Etkin & Reid), None where there are few.

    The differences between neighbouring extrema fall by ``exp(-pi zeta / sqrt(1 - zeta^2))`` each half period,
    whatever the offset.
    """
    slope = np.sign(np.diff(values))
    extrema = np.flatnonzero(slope[1:] * slope[:-1] < 0) + 1
    if len(extrema) < 4:
        return None
    swings = np.abs(np.diff(values[extrema]))
    large = swings > 0.1 * swings.max()
    if large.sum() < 3:
        return None
    half = float(np.mean(np.diff(extrema)[large])) * step
    ratio = np.polyfit(np.flatnonzero(large), np.log(swings[large]), 1)[0]
    damping = -ratio / math.hypot(math.pi, ratio)
    return math.pi / half / math.sqrt(1 - damping**2), float(np.clip(damping, -0.5, 0.95))


def _doubt(fit: SeparableFit, rings: tuple[Record, ...]) -> str:
    """Why the fitted numbers may not be used; empty where they may."""
    if not determined(fit.sensitivities):
        return "the ring-down does not determine frequency and damping"
    if explained(fit, rings) < LEAST_EXPLAINED:
        return "what follows the input is mostly not its free motion: turbulence, or noise"
    longest = max(len(ring.outputs) * ring.step for ring in rings)
    for frequency, damping in fit.values.reshape(-1, 2):
        if not frequency > 0:
            return "no oscillation found in the ring-down"
        if damping > LARGEST_DAMPING:
            return HEAVY
        if frequency * longest < LEAST_TURN * 2 * math.pi:
            return "the ring-down is shorter than two periods of what it may hold"
    return ""


def explained(fit: SeparableFit, rings: tuple[Record, ...]) -> float:
    """Share of the power about the slow drift that the waves explain, of the output where it is largest."""
    total = np.zeros(rings[0].outputs.shape[1])
    for ring in rings:
        drift = np.vander(np.linspace(-1, 1, len(ring.outputs)), DRIFT_ORDER + 1)
        rest = ring.outputs - drift @ np.linalg.lstsq(drift, ring.outputs, rcond=None)[0]
        total += np.sum(rest**2, axis=0)
    left = np.sum(np.vstack(fit.residuals) ** 2, axis=0) * fit.deviation**2
    return float(np.max(1 - left / np.maximum(total, 1e-300)))


def _mode(fit: SeparableFit, rings: tuple[Record, ...], records: Records, kinds: tuple[str, ...]) -> Mode:
    step = rings[0].step
    longest = max(len(ring.outputs) for ring in rings)
    flat = round(records.blur / step)
    lags = int(min(max(longest / 10, 2 * flat), longest / 2)) + 1
    within = coloured_spread(fit.residuals, fit.sensitivities, (flat, lags), fit.linear)
    inverse = np.asarray(np.linalg.inv(information(fit.sensitivities)), dtype=np.float64)
    spread = with_scatter(within, inverse, scores_of(fit.residuals, fit.sensitivities))
    if len(kinds) == 1:
        finer = solve(builder(rings, FINER_DRIFT), fit.values)
        if finer.failure:
            return nothing(METHOD, f"with a finer drift {finer.failure}", kinds)
        shift = finer.values - fit.values
        spread = spread.plus(np.outer(shift, shift))
    # By its interval as well: of a mode of 0.5 just those fits came below the limit that had found too little.
    return without_heavy(paired_mode(METHOD, kinds, fit.values, spread), LARGEST_DAMPING)
