"""Free motion after an input, or without one: damped sinusoids with an offset and a slow drift.

Nonlinear least squares on the ring-down (Jategaonkar, Flight Vehicle System Identification, 2006, ch. 3). All outputs
and records share frequency and damping; amplitudes, phases, offsets and drifts are each one's own.
"""

from __future__ import annotations

import math

import numpy as np

from logs.identification.estimators.modal import LEAST_SAMPLES, ModalFit, ModalMethod, NotIdentified, Record, Records
from logs.identification.estimators.separable import (
    Build,
    SeparableFit,
    SeparableRecord,
    log_squares,
    orthonormal,
    solve,
)
from logs.identification.results import Array
from logs.identification.statistics.covariance import (
    ParameterUncertainty,
    information,
    is_determined,
    record_covariance,
)

DRIFT_ORDER = 2
"""-; of the polynomial in time of each output and record"""
GRID = 24
DAMPINGS = (0.05, 0.3, 0.8)
SLOWER = (0.08, 0.2, 0.4)
"""-; start values of a phugoid's frequency relative to the short period's"""
MIN_EXPLAINED = 0.8
"""-; of the power about the drift"""
MIN_PERIODS = 2.0
"""-; of the ring-down"""
MAX_DAMPING = 0.4
"""-; above which decay and drift are not distinguished: a quarter of a cycle to half amplitude"""


def fit(records: Records, kinds: tuple[str, ...]) -> ModalFit:
    """Modes ``kinds`` from the motion after the input of each record, or from the whole record without an input."""
    rings = ring_downs(records)
    if not rings:
        samples = max(len(piece.outputs) - piece.free_from for piece in records.pieces)
        raise NotIdentified("record_too_short", float(samples), LEAST_SAMPLES, unit="samples after the input")
    if any(np.any(np.ptp(ring.outputs, axis=0) == 0) for ring in rings):
        raise NotIdentified("constant_output")
    found = fit_ring_downs(rings, len(kinds))
    total = information(found.sensitivities)
    if not found.converged or not is_determined(total) or np.any(found.values[::2] <= 0):
        raise NotIdentified("mode_not_identifiable")
    explained = explained_by(found, rings)
    if explained < MIN_EXPLAINED:
        raise NotIdentified("little_explained", explained, MIN_EXPLAINED)
    longest = max(len(ring.outputs) * ring.step for ring in rings)
    for frequency, damping in found.values.reshape(-1, 2):
        if damping > MAX_DAMPING:
            raise NotIdentified("overdamped", float(damping), MAX_DAMPING)
        periods = float(frequency) * longest / (2 * math.pi)
        if periods < MIN_PERIODS:
            raise NotIdentified("record_too_short", periods, MIN_PERIODS, unit="periods of the ring-down")
    inverse = np.asarray(np.linalg.inv(total), dtype=np.float64)
    used, fitted = [np.ones(one.shape) for one in found.residuals], found.nuisances + len(found.values)
    covariance, degrees = record_covariance(found.residuals, used, found.sensitivities, inverse, fitted)
    return ModalFit(found.values, ParameterUncertainty(covariance, float(degrees.min())))


def ring_downs(records: Records) -> tuple[Record, ...]:
    """The part of each record after its input has come to rest."""
    found = []
    for piece in records.pieces:
        rest = piece.outputs[piece.free_from + (piece.free_from > 0) :]
        if len(rest) >= LEAST_SAMPLES:
            found.append(piece._replace(input=None, outputs=rest - rest.mean(axis=0), free_from=0))
    return tuple(found)


def fit_ring_downs(rings: tuple[Record, ...], count: int) -> SeparableFit:
    """``count`` pairs of frequency (rad/s) and damping ratio, from the best of a grid."""
    build = builder(rings)
    longest = max(len(ring.outputs) * ring.step for ring in rings)
    highest = min(0.25 * math.pi / ring.step for ring in rings)
    lowest = min(math.pi / longest, highest / 2)
    starts = [np.array([w, z]) for w in np.geomspace(lowest, highest, GRID) for z in DAMPINGS]
    best = min(starts, key=lambda start: log_squares(build, start))
    if count == 1:
        return solve(build, best)
    pairs = [np.concatenate((best, [best[0] * fraction, 0.1])) for fraction in SLOWER]
    pairs += [np.concatenate(([best[0] / fraction, 0.4], best)) for fraction in SLOWER]
    return solve(build, min(pairs, key=lambda start: log_squares(build, start)))


def builder(rings: tuple[Record, ...], order: int = DRIFT_ORDER) -> Build:
    """The linear problem at frequencies and dampings (2 k,), with a drift of the ``order``."""
    spans = {(len(ring.outputs), ring.step) for ring in rings}

    def build(values: Array) -> list[SeparableRecord]:
        bases = {span: orthonormal(_columns(values, *span, order)) for span in spans}
        records = []
        for ring in rings:
            outputs, basis = ring.outputs.shape[1], bases[len(ring.outputs), ring.step]
            records.append(SeparableRecord(ring.outputs, (basis,) * outputs, (basis[:, :0],) * outputs))
        return records

    return build


def _columns(values: Array, samples: int, step: float, order: int) -> Array:
    """Both solutions of each pair of ``values`` (2 k,) and a polynomial of the ``order``: (N, 2 k + 1 + order)."""
    time = np.linspace(0.0, (samples - 1) * step, samples)
    waves = [wave for w, z in values.reshape(-1, 2).tolist() for wave in damped(time, w, z)]
    return np.column_stack((*waves, np.vander(2 * time / time[-1] - 1, order + 1)))


def damped(time: Array, frequency: float, damping: float) -> tuple[Array, Array]:
    """The two solutions (N,) of ``y'' + 2 zeta omega y' + omega^2 y = 0``, continuous at a damping of 1."""
    root = np.sqrt(complex(damping**2 - 1)) * frequency
    root = root if abs(root) > 1e-9 * abs(frequency) else complex(1e-9 * abs(frequency))
    exponent = np.clip(-damping * frequency * time, -300.0, 300.0)
    up, down = (np.exp(np.clip((exponent + sign * root * time).real, -300, 300) + 1j * (sign * root * time).imag)
                for sign in (1, -1))  # fmt: skip
    return ((up + down) / 2).real, ((up - down) / (2 * root)).real


def explained_by(solution: SeparableFit, rings: tuple[Record, ...]) -> float:
    """Fraction of the power about the drift that the sinusoids explain, of the output where it is largest."""
    total = np.zeros(rings[0].outputs.shape[1])
    for ring in rings:
        drift = np.vander(np.linspace(-1, 1, len(ring.outputs)), DRIFT_ORDER + 1)
        rest = ring.outputs - drift @ np.linalg.lstsq(drift, ring.outputs, rcond=None)[0]
        total += np.sum(rest**2, axis=0)
    left = np.sum(np.vstack(solution.residuals) ** 2, axis=0) * solution.deviation**2
    return float(np.max(1 - left / np.maximum(total, 1e-300)))


FREE_RESPONSE = ModalMethod("free_response", "free response", fit, inputs=False, max_damping=MAX_DAMPING)
METHOD = FREE_RESPONSE.title
free_response = FREE_RESPONSE.mode
