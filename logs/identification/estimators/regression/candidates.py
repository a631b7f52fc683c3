"""A pool of candidate terms, ready for choosing among them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from logs.identification.estimators.regression.design import Design
from logs.identification.estimators.regression.equation_error import Settings, equations
from logs.identification.estimators.regression.least_squares import ROUNDING, Piece, linear_of
from logs.identification.estimators.regression.statistics import (
    System,
    for_colour,
    partial_correlations,
    statistics_of,
    system_of,
)
from logs.identification.results import Array
from logs.identification.statistics.hac import Noise, noise_of, under, white

RANK = 1e-5
"""-; a candidate's least share of its own size that the terms before it do not explain"""
SAMPLES_PER_TERM = 10
MOST_COMPLETE = 24
"""-; terms in the model whose residuals tell the noise"""


class Candidates(NamedTuple):
    """Candidates with what the tests need of them."""

    names: tuple[str, ...]
    """-; (p,)"""
    pieces: tuple[Piece, ...]
    """nuisances (means, trends) first, then the candidates; columns of unit length over all records"""
    nuisances: int
    """-; how many columns they are"""
    system: System
    """the candidates alone, what the nuisances say of them taken out"""
    lengths: Array
    """(p,); what each candidate was divided by, as the candidate"""
    noise: Noise | None
    """of the most complete model, None where its residuals are nothing but rounding"""


def candidates_of(design: Design, settings: Settings) -> Candidates:
    """The columns of ``design`` as candidates, counted in independent samples."""
    asked = equations(design, "time", settings)
    nuisances = len(asked.names) - len(design.names)
    size = np.linalg.norm(np.vstack([piece.regressors for piece in asked.pieces]), axis=0)
    scale = np.where(size > 0, size, 1.0)
    unit = [piece.regressors / scale for piece in asked.pieces]
    pieces = tuple(p._replace(regressors=u, instruments=u) for p, u in zip(asked.pieces, unit, strict=True))
    found = Candidates(design.names, pieces, nuisances, system_of(pieces, nuisances), scale[nuisances:], None)
    return _coloured(found, _most_complete(found))


def pieces_of(candidates: Candidates, chosen: tuple[int, ...]) -> tuple[Piece, ...]:
    """The records with only the nuisances and the ``chosen`` candidates."""
    columns = [*range(candidates.nuisances), *(candidates.nuisances + column for column in chosen)]
    taken = ((piece, piece.regressors[:, columns]) for piece in candidates.pieces)
    return tuple(Piece(regressors, regressors, piece.response, piece.used) for piece, regressors in taken)


def determined(candidates: Candidates, chosen: tuple[int, ...]) -> bool:
    """Whether the ``chosen`` are independent of one another."""
    columns = candidates.system.columns[:, chosen]
    scaled = columns / np.linalg.norm(columns, axis=0)
    return bool(np.linalg.svd(scaled, compute_uv=False)[-1] > RANK)


def _most_complete(candidates: Candidates) -> tuple[int, ...]:
    """Independent candidates, of the highest partial correlation first, as many as the samples bear."""
    chosen: tuple[int, ...] = ()
    most = min(len(candidates.names), max(len(candidates.system.response) // SAMPLES_PER_TERM, 1), MOST_COMPLETE)
    while len(chosen) < most:
        correlations = np.abs(partial_correlations(candidates.system, chosen))
        best = int(np.argmax(correlations))
        if correlations[best] <= 0 or not determined(candidates, (*chosen, best)):
            break
        chosen = (*chosen, best)
    return chosen


def _coloured(candidates: Candidates, chosen: tuple[int, ...]) -> Candidates:
    """The candidates with the noise that the terms ``chosen`` leave.

    Samples are counted over the median factor by which its colour raises the variances of those terms.
    """
    system = candidates.system
    _, records = linear_of(pieces_of(candidates, chosen))
    left = statistics_of(system, chosen)
    if not chosen or not left.r_squared < 1 - ROUNDING:
        return candidates
    noise = noise_of(records)
    raised, plain = (np.diag(c.covariance)[candidates.nuisances :] for c in (under(noise, records), white(records)))
    count = len(system.response)
    factor = float(np.clip(np.median(raised / plain), 1.0, count / 3))
    return candidates._replace(system=for_colour(system, count / factor, left.variance), noise=noise)
