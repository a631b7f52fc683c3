"""The equivalent system of short records: what it tells of them, and when it tells nothing."""

from __future__ import annotations

import numpy as np
import pytest
from linear_ornithopter import Flight, flight_records, fly, model_of
from scipy.linalg import block_diag
from scipy.signal import lsim

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equivalent_system import builder, equivalent_system, transform
from logs.identification.estimators.records import Records, records_of
from logs.identification.estimators.variable_projection import Build, Piece, residuals_at, taken
from logs.identification.models.modes import PHUGOID, Mode, short_period_of
from logs.identification.results import Array
from logs.identification.statistics.noise_spectrum import power_law

FREQUENCY, DAMPING = short_period_of(model_of(Flight()).a)
AT_TRUTH = np.array([FREQUENCY, DAMPING, 0.0, 0.0, 0.0])


def found(flight: Flight) -> Mode:
    return equivalent_system(flight_records(fly(flight)))


def held(mode: Mode) -> bool:
    assert mode.frequency is not None and mode.damping is not None
    return mode.frequency.contains(FREQUENCY) and mode.damping.contains(DAMPING)


def test_short_records_hold_the_truth() -> None:
    """GIVEN few frequencies a record THEN what its ends take of the lowest is not taken for an absence of noise."""
    modes = [found(Flight(seed=seed, settle=1.0)) for seed in range(6)]
    assert all(held(mode) for mode in modes)
    off = [mode.frequency.value / FREQUENCY - 1.0 for mode in modes if mode.frequency is not None]
    assert abs(np.median(off)) < 0.05


def test_records_that_are_half_ends_are_refused() -> None:
    mode = found(Flight(settle=0.6))
    assert mode.frequency is None
    assert "half of what they hold is how they begin and end" in mode.unidentified[0].reason


def test_what_is_not_explained_is_not_hidden_by_weights() -> None:
    """GIVEN a gust that rings the aircraft THEN whitened residuals do not make a model of it."""
    mode = found(Flight(gust=0.15, seed=1))
    assert mode.frequency is None
    assert "explains too little" in mode.unidentified[0].reason


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
    assert "1.3 periods in all" in mode.unidentified[0].reason


def of_flight() -> tuple[list[Piece], Build, Array]:
    """The records of a short flight, made linear at the true mode; and the frequencies of their ordinates."""
    records = flight_records(fly(Flight(settle=0.83)))
    transforms = [transform(record, records.blur) for record in records.pieces]
    build = builder(transforms, records, [np.ones(t.outputs.shape) for t in transforms], 1)
    return build(AT_TRUTH), build, np.concatenate([np.abs(t.s) for t in transforms])


def test_unknowns_take_what_the_matrix_of_all_of_them_projects_on() -> None:
    """GIVEN what each record has for itself and what all share THEN leverages are those of one regression on both."""
    pieces, build, _ = of_flight()
    shares = taken(build, AT_TRUTH)
    for output in range(shares.shape[1]):
        own = block_diag(*[piece.own[output] for piece in pieces])
        columns = np.column_stack((own, np.vstack([piece.shared[output] for piece in pieces])))
        along = np.linalg.qr(columns / np.linalg.norm(columns, axis=0))[0]
        np.testing.assert_allclose(shares[:, output], np.sum(along**2, axis=1), atol=1e-9)


def test_the_noise_of_a_short_flight_is_white_where_it_is() -> None:
    """GIVEN white noise in place of outputs THEN what the ends leave of it has no slope, and without them has one."""
    pieces, build, frequency = of_flight()
    left = 1.0 - taken(build, AT_TRUTH)[:, 0]
    degrees, rng = by_ordinate(left, pieces), np.random.default_rng(7)
    laws = []
    for _ in range(40):
        noisy = [piece._replace(measured=rng.normal(size=piece.measured.shape)) for piece in pieces]
        rest = np.vstack(residuals_at(lambda values, noisy=noisy: noisy, AT_TRUTH)[0])[:, 0]
        power = by_ordinate(rest**2, pieces)
        laws.append([power_law(frequency, power, each) for each in (degrees, np.full_like(degrees, 2.0))])
    (level, slope), (low, steep) = np.mean(laws, axis=0)
    assert abs(slope) < 0.15 and abs(level) < 0.4
    assert steep > 0.5 and low < -1.5


def by_ordinate(both: Array, pieces: list[Piece]) -> Array:
    """Real and imaginary part of each ordinate added up, record behind record."""
    halves = [np.split(one, 2) for one in np.split(both, np.cumsum([len(piece.measured) for piece in pieces])[:-1])]
    return np.concatenate([real + imaginary for real, imaginary in halves])
