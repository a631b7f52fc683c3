"""Linear equation error: a measured quantity as a sum of named regressors (Grauer Eq. 17 to 20).

In the time domain ordinary least squares over the samples that have every signal, in the frequency domain
`frequency_domain`. Means and trends that belong to a manoeuvre, not to the aircraft, are regressors of their own, so
that the errors contain what they cost (Klein & Morelli, Aircraft System Identification, 2006, ch. 5 and 7).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np

from logs.identification.estimators.regression.averaging import Averaging
from logs.identification.estimators.regression.design import INTERCEPT, Design, Record
from logs.identification.estimators.regression.frequency_domain import (
    checked,
    default_frequencies,
    in_band,
    transform,
)
from logs.identification.estimators.regression.least_squares import Piece
from logs.identification.results import Array
from wingbeat.errors import InputError

Domain = Literal["time", "frequency"]


class Settings(NamedTuple):
    """What a regression may be told."""

    intercept: Literal["common", "each", "none"] = "common"
    """-; one for all manoeuvres, one for each, or none"""
    trend: int | None = None
    """-; order of a polynomial in time that each manoeuvre has for itself; None: 0 in time, 1 in frequency"""
    frequencies: Array | None = None
    """Hz; (F,), where the transform is taken; None: `frequency_domain.default_frequencies`"""
    longest_gap: int = 5
    """-; samples in a row that the frequency domain interpolates"""
    covariance: Literal["parzen", "all lags", "white"] = "parzen"
    """-; how the residuals' colour enters, see `statistics.hac`"""
    constants: Mapping[str, float] = MappingProxyType({})
    """SI; by name, for regressors such as q*c/2V"""
    units: Mapping[str, str] = MappingProxyType({})
    """SI unit by the constant's name"""
    averaging: Averaging | None = None
    """what the columns are averaged with, where some are slopes over several samples"""


class Equations(NamedTuple):
    """A regression ready to be solved: nuisances first, then the design's regressors."""

    names: tuple[str, ...]
    """-; (p,), of all columns"""
    reported: tuple[bool, ...]
    """-; (p,), False for a trend"""
    pieces: tuple[Piece, ...]
    separate: Array
    """(M, r); the design's regressors without their nuisances, in samples or transformed: what must be independent"""
    frequencies: Array
    """Hz; (F,), empty in the time domain"""


def equations(design: Design, domain: Domain, settings: Settings) -> Equations:
    """The ``design``'s equations in the ``domain``; in the frequency domain it must be `frequency_domain.bridged`.

    Raises:
        InputError: unknown domain, frequencies that the record cannot hold.
    """
    if domain not in ("time", "frequency"):
        raise InputError(f"domain '{domain}' is neither time nor frequency")
    order = settings.trend if settings.trend is not None else int(domain == "frequency")
    names, reported, nuisances = _nuisances(design.records, settings.intercept, order)
    if domain == "time":
        pieces = tuple(_in_time(r, n) for r, n in zip(design.records, nuisances, strict=True))
        return Equations(
            (*names, *design.names), _all(reported, design), pieces, _cleared(pieces, len(names)), np.zeros(0)
        )
    frequencies = default_frequencies(design) if settings.frequencies is None else settings.frequencies
    frequencies = checked(frequencies, design)
    bands = [_in_band(r, n, frequencies, design.step) for r, n in zip(design.records, nuisances, strict=True)]
    separate = np.vstack([spectrum for _, spectrum in bands])
    return Equations(
        (*names, *design.names), _all(reported, design), tuple(p for p, _ in bands), separate, frequencies
    )


def _all(reported: tuple[bool, ...], design: Design) -> tuple[bool, ...]:
    return (*reported, *(True for _ in design.names))


def _nuisances(
    records: tuple[Record, ...], intercept: str, order: int
) -> tuple[tuple[str, ...], tuple[bool, ...], list[Array]]:
    """Names, whether they are reported, and columns (N, k) of each record."""
    names: list[str] = []
    blocks: list[list[Array]] = [[] for _ in records]
    if intercept == "common":
        names.append(INTERCEPT)
        for block, record in zip(blocks, records, strict=True):
            block.append(record.used)
    kept = len(names)
    for owner, record in enumerate(records):
        powers = range(0 if intercept == "each" else 1, order + 1) if intercept != "none" else range(1, order + 1)
        for power in powers:
            names.append(f"{INTERCEPT} of {record.name}" if power == 0 else f"t^{power} of {record.name}")
            for index, (block, other) in enumerate(zip(blocks, records, strict=True)):
                own = np.linspace(-1, 1, len(other.used)) ** power * other.used
                block.append(own if index == owner else np.zeros(len(other.used)))
    reported = tuple(index < kept or name.startswith(INTERCEPT) for index, name in enumerate(names))
    columns = [np.column_stack(b) if b else np.zeros((len(r.used), 0)) for b, r in zip(blocks, records, strict=True)]
    return tuple(names), reported, columns


def _in_time(record: Record, nuisance: Array) -> Piece:
    regressors = np.hstack((nuisance, record.regressors))
    return Piece(regressors, regressors, record.response, record.used)


def _in_band(record: Record, nuisance: Array, frequencies: Array, step: float) -> tuple[Piece, Array]:
    """The record's piece, and its regressors' transform (2 F, r), real parts first."""
    steady = np.column_stack((np.ones(len(record.used)), nuisance))
    clean = _rest(steady, record.regressors)
    spectrum = transform(clean, frequencies, step)
    instruments = _rest(steady, in_band(clean, frequencies, step))
    regressors = np.hstack((nuisance, record.regressors))
    piece = Piece(regressors, np.hstack((nuisance, instruments)), record.response, record.used)
    return piece, np.vstack((spectrum.real, spectrum.imag))


def _cleared(pieces: tuple[Piece, ...], count: int) -> Array:
    """Regressors (N, r) of all records without what the first ``count`` columns, the nuisances, say of them."""
    whole = np.vstack([piece.regressors * piece.used[:, None] for piece in pieces])
    return _rest(whole[:, :count], whole[:, count:])


def _rest(nuisance: Array, columns: Array) -> Array:
    """``columns`` (N, r) orthogonal to ``nuisance`` (N, k); what only rounding leaves is zero."""
    if not nuisance.shape[1]:
        return columns
    rest = columns - nuisance @ np.linalg.lstsq(nuisance, columns, rcond=None)[0]
    alike = np.linalg.norm(rest, axis=0) <= 1e-12 * np.linalg.norm(columns, axis=0)
    return np.where(alike, 0.0, rest)
