"""Coverage of the short period and of derivatives by output, equation and filter error on simulated flights."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import Flight, fits_of, fly
from promised import SEEDS

from logs.identification.data.maneuvers import Reference
from logs.identification.estimators.flight_modes import EQUATION_ERROR, FILTER_ERROR, OUTPUT_ERROR, mode_of
from logs.identification.models.modes import Mode, short_period_of
from logs.identification.models.stroke_averaged import matrices
from logs.identification.results import Estimate

ASKED = 0.88, 0.995
"""-; least and greatest share of intervals that contain the truth, over all parameters of a cell"""
NAMES = ("short_period_frequency", "short_period_damping", "M_w", "M_q", "M_delta", "Z_w")


def truth_of(flight: Flight, reference: Reference) -> dict[str, float]:
    """The derivatives, and the modes that they make at the flight condition of the maneuvers."""
    names = tuple(flight.truth)
    model = matrices(names, np.array([flight.truth[n] for n in names]), reference, flight.aircraft)
    frequency, damping = short_period_of(model.a)
    return flight.truth | {"short_period_frequency": frequency, "short_period_damping": damping}


def estimates_of(mode: Mode) -> dict[str, Estimate]:
    assert mode.short_period is not None
    return {one.name: one for one in (*mode.short_period.estimates, *mode.derivatives)}


def coverage(flight: Flight, seeds: range) -> dict[str, dict[str, float]]:
    """Share of the intervals of each method that contain the truth, by parameter."""
    hits: dict[str, list[list[bool]]] = {}
    for seed in seeds:
        problem, fits = fits_of(fly(flight._replace(seed=seed)))
        truth = truth_of(flight, problem.reference)
        methods = {OUTPUT_ERROR: fits.output, EQUATION_ERROR: fits.equation, FILTER_ERROR: fits.filter.fit}
        for method, fit in methods.items():
            found = estimates_of(mode_of(method, problem, fit))
            hits.setdefault(method, []).append([found[name].contains(truth[name]) for name in NAMES])
    return {method: dict(zip(NAMES, np.mean(rows, axis=0).tolist(), strict=True)) for method, rows in hits.items()}


@pytest.mark.validate
def test_intervals_of_a_few_flights() -> None:
    found = coverage(Flight(), range(3))
    assert all(np.mean(list(shares.values())) >= 0.75 for shares in found.values()), found


@pytest.mark.validate
@pytest.mark.parametrize("width", [0.1, 0.2, 0.4])
def test_coverage_of_many_flights(width: float) -> None:
    found = coverage(Flight(width=width), range(len(SEEDS) // 3))
    for method, shares in found.items():
        print(width, method, {name: round(share, 3) for name, share in shares.items()})  # noqa: T201
        assert ASKED[0] <= np.mean(list(shares.values())) <= ASKED[1]
