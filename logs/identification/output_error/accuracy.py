"""Cramer-Rao bounds corrected for coloured residuals, and what the data does not tell.

Morelli & Klein, Accuracy of Aerodynamic Model Parameters Estimated from Flight Test Data, J. Guidance 20(1), 1997.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.accuracy.colour import colour_of, coloured_information
from logs.identification.accuracy.widened import not_below
from logs.identification.output_error.flown import Flight
from logs.identification.output_error.normal import Normal, Spectrum, pseudo_inverse, reduced, spectrum_of
from logs.identification.output_error.records import Indices
from logs.identification.output_error.search import Found
from logs.identification.output_error.weights import about_mean, whitener_of
from logs.identification.results import Array, Unidentified, student_factor

LAG_SHARE = 0.1
"""-; of the longest record: width of the lag window"""
MIXED = 1e-2
"""-; share of a parameter in a direction that the data does not determine"""
WIDEST = 1.0
"""-; of a value: half an interval, from which on it must also move the outputs less than they moved"""


class Accuracy(NamedTuple):
    """What the estimates are worth."""

    covariance: Array
    """(p, p); zero in the rows of what is not identified"""
    degrees: float
    """-; effective degrees of freedom"""
    unidentified: tuple[Unidentified, ...]


def accuracy_of(flight: Flight, found: Found, names: tuple[str, ...]) -> Accuracy:
    """Errors of the parameters that are not held at a bound, nuisances and colour of the residuals included."""
    assert found.normal is not None
    free, p = np.flatnonzero(~found.held), len(names)
    equations = reduced(found.normal).only(free)
    spectrum = spectrum_of(equations, found.normal.sizes[free])
    inner, degrees = _sandwich(flight, found.normal, free, spectrum.inverse(), equations.rank)
    covariance = np.zeros((p, p))
    covariance[np.ix_(free, free)] = inner
    values = found.unknowns.values
    lost = {names[i]: f"it stays at its bound {values[i]:g}" for i in np.flatnonzero(found.held)}
    lost |= _undetermined(spectrum, [names[i] for i in free])
    halves = np.sqrt(np.diag(covariance)) * student_factor(degrees)
    lost = _too_wide(flight, found, halves, names) | lost
    for index in (names.index(name) for name in lost):
        covariance[index], covariance[:, index] = 0.0, 0.0
    return Accuracy(covariance, degrees, tuple(Unidentified(n, lost[n]) for n in names if n in lost))


def _sandwich(flight: Flight, normal: Normal, free: Indices, inverse: Array, rank: int) -> tuple[Array, float]:
    residuals = [piece.residuals for piece in normal.pieces]
    used = [record.used for record in flight.records]
    longest = max(len(piece) for piece in residuals)
    colour = colour_of(residuals, used, max(int(LAG_SHARE * longest), 1) + 1)
    degrees = max(colour.effective - len(free) - rank, 1.0)
    sensitivities = []
    for piece in normal.pieces:
        inner, _ = pseudo_inverse(piece.own.T @ piece.own)
        rest = piece.slopes[:, free] - piece.own @ (inner @ (piece.own.T @ piece.slopes[:, free]))
        sensitivities.append(rest.reshape(*piece.residuals.shape, len(free)))
    core = coloured_information(sensitivities, colour) * (colour.effective / degrees)
    covariance = inverse @ core @ inverse
    count = sum(float(mask.sum()) for mask in used)
    variance = sum(float(np.sum(piece**2)) for piece in residuals) / max(count - len(free) - rank, 1.0)
    return not_below(covariance, inverse * variance), degrees


def _undetermined(spectrum: Spectrum, names: list[str]) -> dict[str, str]:
    """Parameters in directions that change nothing, by name, with what they are mixed up with."""
    lost: dict[str, str] = {}
    null = spectrum.vectors[:, ~spectrum.kept]
    share = np.sqrt(np.sum(null**2, axis=1))
    for index, name in enumerate(names):
        if not np.isfinite(spectrum.scale[index]):
            lost[name] = "it has no effect on the fitted outputs"
        elif share[index] > MIXED:
            alike = np.abs(null @ null[index]) > MIXED * share[index]
            others = [other for i, other in enumerate(names) if alike[i] and other != name]
            lost[name] = "the data does not tell it from " + (
                ", ".join(others) if others else "the initial states and biases"
            )
    return lost


def _too_wide(flight: Flight, found: Found, halves: Array, names: tuple[str, ...]) -> dict[str, str]:
    """Parameters that could be anything: half their interval exceeds them and would move the outputs more than
    they moved."""
    assert found.normal is not None
    motion, alone = _motion(flight, found.weights), np.sqrt(reduced(found.normal).alone)
    wide: dict[str, str] = {}
    for name, half, value, effect in zip(names, halves, found.unknowns.values, alone, strict=True):
        if not np.isfinite(half) or (half > WIDEST * abs(value) and half * effect > motion):
            wide[name] = "its interval is too wide to be of use: half of it exceeds the value"
    return wide


def _motion(flight: Flight, weights: Array) -> float:
    """Norm of the outputs' own motion about their means, as the search weighs it."""
    squares = [float(np.sum(whitener_of(r, weights)(about_mean(r)) ** 2)) for r in flight.records]
    return float(np.sqrt(sum(squares)))
