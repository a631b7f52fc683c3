"""Do 95 % intervals of regressions hold the truth in 95 % of the flights? Short records, any colour of residuals."""

from __future__ import annotations

import numpy as np
import pytest
from promised import SEEDS

from logs.identification.diagnostics import Context
from logs.identification.diagnostics.estimates import few_independent_samples
from logs.identification.estimators.equation_error import Settings, coefficient_regression
from logs.identification.estimators.registry import ESTIMATORS, Request
from tests.logs.identification.colored_noise import KINDS, TRUTH, simulated

COUNTS = (100, 250, 1000)
FINE = np.arange(0.1, 3.0, 0.04)
"""Hz; finer than a 10 s record resolves"""


def covered(kind: str, count: int, seeds: range, domain: str, settings: Settings) -> list[int]:
    """How many of the intervals of each parameter hold its truth."""
    hits = dict.fromkeys(TRUTH, 0)
    for seed in seeds:
        found = coefficient_regression(
            (simulated(kind, count, seed),), "C", ("alpha", "q", "delta"), domain, settings
        )
        assert not found.failure and not found.withheld
        for one in found.estimates:
            hits[one.name] += one.contains(TRUTH[one.name])
    return list(hits.values())


@pytest.mark.parametrize(("kind", "domain"), [("white", "time"), ("AR 0.97", "time"), ("flapping", "frequency")])
def test_intervals_hold_on_a_hundred_samples(kind: str, domain: str) -> None:
    assert min(covered(kind, 100, range(12), domain, Settings())) >= 9


@pytest.mark.parametrize(
    ("kind", "expected"), [("white", ()), ("AR 0.5", ()), ("AR 0.97", ("few_independent_samples",))]
)
def test_few_independent_samples_are_reported(kind: str, expected: tuple[str, ...]) -> None:
    """GIVEN 250 samples THEN residuals that are correlated over much of the record are found, others are not."""
    record = simulated(kind, 250, 1)
    result = ESTIMATORS["equation_error_time"].estimate(
        Request((record,), outputs=("C",), regressors=("alpha", "q", "delta"))
    )
    found = few_independent_samples(Context((record,), result=result))
    assert tuple(one.code for one in found) == expected
    assert all(one.value is not None and one.value < 30.0 for one in found)


def check(cell: str, hits: list[int]) -> None:
    """The derivatives' intervals contain the truth as required; the mean of slow noise is short of samples."""
    shares = dict(zip(TRUTH, (hit / len(SEEDS) for hit in hits), strict=True))
    print(cell, {name: round(share, 3) for name, share in shares.items()})  # noqa: T201
    assert 0.88 <= np.mean([shares[name] for name in ("alpha", "q", "delta")]) <= 1.0


CELLS = [(domain, kind, count) for domain in ("time", "frequency") for kind in KINDS for count in COUNTS]


@pytest.mark.validate
@pytest.mark.parametrize(("domain", "kind", "count"), CELLS)
def test_intervals_hold_over_many_flights(domain: str, kind: str, count: int) -> None:
    hits = covered(kind, count, SEEDS, domain, Settings())
    check(f"{domain} {kind} N={count}", hits)


@pytest.mark.validate
@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_in_a_band_with_frequencies_finer_than_the_record(kind: str) -> None:
    hits = covered(kind, 250, SEEDS, "frequency", Settings(frequencies=FINE))
    check(f"fine band {kind} N=250", hits)
