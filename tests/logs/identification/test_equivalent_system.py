"""The equivalent system of short records: modes inside their intervals, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import Flight, flight_records, fly, model_of
from scipy.linalg import block_diag
from scipy.signal import lsim

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equivalent_system import equivalent_system
from logs.identification.estimators.modal import Records, records_of
from logs.identification.models.modes import PHUGOID, Mode, short_period_of

FREQUENCY, DAMPING = short_period_of(model_of(Flight()).a)


def identified(flight: Flight) -> Mode:
    return equivalent_system(flight_records(fly(flight)))


@pytest.mark.validate
def test_stroke_averages_give_the_short_period() -> None:
    """GIVEN flights of the linear ornithopter THEN frequency and damping are inside nearly all intervals."""
    hits = []
    for seed in range(10):
        mode = identified(Flight(seed=seed))
        assert mode.frequency is not None and mode.damping is not None
        hits += [mode.frequency.contains(FREQUENCY), mode.damping.contains(DAMPING)]
    assert np.mean(hits) >= 0.85


SLOW = (0.2, 0.05)


def ringing(pairs: tuple[tuple[float, float], ...], shares: tuple[float, ...]) -> Records:
    """Pitch and pitch rate for 200 s after an input, of oscillators with these frequencies and dampings."""
    step, count = 0.1, len(pairs)
    time = np.arange(0.0, 200.0, step)
    given = np.where((time > 2) & (time < 5), 0.05, 0.0) - np.where((time >= 5) & (time < 6), 0.05, 0.0)
    system = block_diag(*[[[0.0, 1.0], [-(w**2), -2 * z * w]] for w, z in pairs])
    _, _, states = lsim((system, [[0.0], [1.0]] * count, np.eye(2 * count), np.zeros((2 * count, 1))), given, time)
    noise = 1e-4 * np.random.default_rng(3).normal(size=(2, len(time)))
    pitch, rate = noise + sum(share * states[:, [2 * k, 2 * k + 1]].T for k, share in enumerate(shares))
    signals = {"q": rate, "theta": pitch, "delta_e": given}
    units = {"q": "rad/s", "theta": "rad", "delta_e": "rad"}
    return records_of((Experiment("one", time, signals, units),), "delta_e", ("q", "theta"))


@pytest.mark.parametrize(("pairs", "shares"), [(((2.0, 0.3), SLOW), (1.0, 0.3)), ((SLOW,), (1.0,))])
def test_a_phugoid_alone_is_the_slower_of_those_that_ring(
    pairs: tuple[tuple[float, float], ...], shares: tuple[float, ...]
) -> None:
    """GIVEN a pitch that rings at 2 and at 0.2 rad/s, or at the latter alone THEN the phugoid is the latter."""
    mode = equivalent_system(ringing(pairs, shares), (PHUGOID,))
    assert mode.short_period is None and mode.phugoid is not None
    assert mode.phugoid.frequency.contains(SLOW[0]) and mode.phugoid.damping.contains(SLOW[1])
    assert mode.phugoid.frequency.standard_error < 0.002


def test_a_phugoid_of_few_periods_has_no_number() -> None:
    """GIVEN 40 s of it, with a short period of many periods beside THEN its own periods count."""
    whole = ringing(((2.0, 0.3), SLOW), (1.0, 0.3))
    piece = whole.pieces[0]
    short = piece._replace(input=None if piece.input is None else piece.input[:400], outputs=piece.outputs[:400])
    mode = equivalent_system(whole._replace(pieces=(short,)), (PHUGOID,))
    assert mode.phugoid is None
    assert mode.withheld
