"""What is promised of the short period: 300 flights a setting, each parameter of each method that gives a number."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, TRUTH, Flight, fly
from promised import SEEDS, modes_kept

from logs.identification.data.maneuvers import Reference, find_manoeuvres, reference_of
from logs.identification.estimators.equivalent_system import equivalent_system
from logs.identification.estimators.flight.short_period import (
    FITTED_OUTPUTS,
    fit_derivatives,
    identify_modes,
    mode_of,
    records_flown,
)
from logs.identification.estimators.flight.simulation import Problem
from logs.identification.models.modes import Mode, short_period_of
from logs.identification.models.stroke_averaged import LONGITUDINAL, matrices

PHYSICAL = ("output error", "equation error, frequency domain")
EQUIVALENT = "equivalent system"
LIGHT = Flight(truth=TRUTH | {"M_q": -0.5, "Z_w": -1.0}, settle=2.5)
"""so lightly damped that methods without a physical model tell decay from drift"""


class Found(NamedTuple):
    """Of every flight the mode by each method, refusals too."""

    modes: dict[str, list[Mode]]
    """by the method's name"""
    truths: list[dict[str, float]]
    """of each flight"""


def flown(flight: Flight) -> Found:
    """By every method."""
    found = [identify_modes(fly(flight._replace(seed=seed)), AIRCRAFT) for seed in SEEDS]
    rows = zip(*(one.modes for one in found), strict=True)
    truths = [truth_of(flight, one.reference) for one in found if one.reference is not None]
    return Found({row[0].method: list(row) for row in rows}, truths)


def quickly(flight: Flight) -> Found:
    """By output error, equation error and the equivalent system alone, which takes a quarter of the time."""
    found: dict[str, list[Mode]] = {method: [] for method in (*PHYSICAL, EQUIVALENT)}
    truths = []
    for seed in SEEDS:
        data = fly(flight._replace(seed=seed))
        manoeuvres = find_manoeuvres(data, AIRCRAFT)
        reference = reference_of(data, manoeuvres)
        problem = Problem(manoeuvres, reference, AIRCRAFT, LONGITUDINAL, FITTED_OUTPUTS)
        fits = fit_derivatives(problem)
        for method, fit in zip(PHYSICAL, reversed(fits), strict=True):
            found[method].append(mode_of(method, fit, reference, AIRCRAFT))
        found[EQUIVALENT].append(equivalent_system(records_flown(problem, fits[1])))
        truths.append(truth_of(flight, reference))
    return Found(found, truths)


def truth_of(flight: Flight, reference: Reference) -> dict[str, float]:
    """The derivatives, and the modes that they make at the flight condition about which a flight tells its own.

    Doublets of 0.15 rad move the means: the lightly damped aircraft noses 0.004 rad down and has 0.4 % less damping
    there, twice its interval.
    """
    names = tuple(flight.truth)
    model = matrices(names, np.array([flight.truth[n] for n in names]), reference, flight.aircraft)
    frequency, damping = short_period_of(model.a)
    return flight.truth | {"short_period_frequency": frequency, "short_period_damping": damping}


@pytest.mark.validate
@pytest.mark.parametrize("width", [0.1, 0.2, 0.4])
@pytest.mark.parametrize("modulation", [0.0, 0.3])
def test_what_is_promised_of_a_well_damped_short_period(modulation: float, width: float) -> None:
    """Doublets of three widths, by wings whose stroke modulates Z_w, M_w and M_q or does not."""
    flight = Flight(modulation=modulation, width=width)
    study = f"modulation {modulation}, doublets of {width} s"
    found = quickly(flight)
    modes_kept(study, found.modes.values(), found.truths)


@pytest.mark.validate
@pytest.mark.parametrize(("modulation", "settle"), [(0.0, 0.8), (0.3, 0.8), (0.3, 0.85)])
def test_what_is_promised_of_records_of_two_seconds(modulation: float, settle: float) -> None:
    """At 0.8 s all inputs come at one phase of the stroke, at 0.85 at all its phases."""
    found = quickly(Flight(modulation=modulation, settle=settle))
    if settle == 0.8:
        assert all(mode.frequency is None for mode in found.modes.pop(EQUIVALENT)), "at one phase it refuses"
    modes_kept(f"modulation {modulation}, {settle} s of rest", found.modes.values(), found.truths)


@pytest.mark.validate
def test_what_is_promised_of_a_lightly_damped_short_period() -> None:
    """Every method that the records allow gives numbers."""
    found = flown(LIGHT)
    del found.modes["spectrum"]
    modes_kept("lightly damped", found.modes.values(), found.truths)


@pytest.mark.validate
def test_methods_agree_on_a_stroke_that_modulates() -> None:
    results = [identify_modes(fly(Flight(seed=seed, modulation=0.3)), AIRCRAFT) for seed in range(40)]
    assert sum(bool(result.agree) for result in results) >= 34
