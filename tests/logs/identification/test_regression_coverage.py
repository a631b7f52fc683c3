"""Do 95 % intervals of regressions hold the truth in 95 % of the flights? Short records, any colour of residuals."""

from __future__ import annotations

import numpy as np
import pytest
from promised import SEEDS, promise_kept

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.equation_error import Settings, coefficient_regression
from tests.logs.identification.coloured_noise import KINDS, TRUTH, flown

COUNTS = (100, 250, 1000)
FINE = np.arange(0.1, 3.0, 0.04)
"""Hz; finer than a 10 s record resolves"""


def covered(kind: str, count: int, seeds: range, domain: str, settings: Settings) -> list[int]:
    """How many of the intervals of each parameter hold its truth."""
    hits = dict.fromkeys(TRUTH, 0)
    for seed in seeds:
        found = coefficient_regression((flown(kind, count, seed),), "C", ("alpha", "q", "delta"), domain, settings)
        assert not found.failure and not found.unidentified
        for one in found.estimates:
            hits[one.name] += one.contains(TRUTH[one.name])
    return list(hits.values())


@pytest.mark.parametrize(("kind", "domain"), [("white", "time"), ("AR 0.97", "time"), ("flapping", "frequency")])
def test_intervals_hold_on_a_hundred_samples(kind: str, domain: str) -> None:
    assert min(covered(kind, 100, range(12), domain, Settings())) >= 9


def shares(hits: list[int]) -> dict[str, float]:
    return dict(zip(TRUTH, (hit / len(SEEDS) for hit in hits), strict=True))


CELLS = [(domain, kind, count) for domain in ("time", "frequency") for kind in KINDS for count in COUNTS]


@pytest.mark.validate
@pytest.mark.parametrize(("domain", "kind", "count"), CELLS)
def test_intervals_hold_over_many_flights(domain: str, kind: str, count: int) -> None:
    hits = covered(kind, count, SEEDS, domain, Settings())
    promise_kept(f"{domain} {kind} N={count}", shares(hits))


@pytest.mark.validate
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_in_a_band_with_frequencies_finer_than_the_record(kind: str) -> None:
    hits = covered(kind, 250, SEEDS, "frequency", Settings(frequencies=FINE))
    promise_kept(f"fine band {kind} N=250", shares(hits))


def test_a_smooth_response_is_not_taken_for_slow_noise() -> None:
    """GIVEN a response smoother than the noise in its regressor THEN the errors are those of what is left over.

    The likeliest noise would make all of the response, and errors forty times as large as the scatter.
    """
    time, values, errors = 0.04 * np.arange(625), [], []
    motion = np.sin(2.0 * time) * np.exp(-0.1 * time)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        measured = motion + 0.1 * rng.normal(size=len(time))
        told = 3.0 * motion + 0.005 * rng.normal(size=len(time))
        one = Experiment("one", time, {"q": measured, "C": told}, {"q": "rad/s", "C": "-"})
        (_, found) = coefficient_regression((one,), "C", ("q",)).estimates
        values.append(found.value)
        errors.append(found.standard_error)
    assert 0.7 < np.median(errors) / np.std(values) < 1.7
