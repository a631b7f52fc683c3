"""Of several methods the one that disagrees is named; methods that share the truth agree."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.diagnostics.agreement import agreement
from logs.identification.models.modes import Mode, Oscillation, nothing, oscillation, short_period_of, split_pairs
from logs.identification.statistics.covariance import ParameterUncertainty


def identified_mode(method: str, frequency: float, damping: float, error: float = 0.05) -> Mode:
    pair = oscillation(
        "short_period", np.array([frequency, damping]), ParameterUncertainty(np.diag([error**2, 0.01**2]), 50.0)
    )
    assert isinstance(pair, Oscillation)
    return Mode(method, pair, None, (), (), ())


def test_methods_within_their_errors_agree() -> None:
    agree, statement = agreement(
        (identified_mode("a", 6.0, 0.5), identified_mode("b", 6.05, 0.51), identified_mode("c", 5.96, 0.49))
    )
    assert agree is True
    assert statement == "all 3 methods agree within the 95 % interval of their difference"


def test_the_outlier_is_named() -> None:
    modes = (
        identified_mode("a", 6.0, 0.5),
        identified_mode("b", 7.0, 0.5),
        identified_mode("c", 6.02, 0.51),
        nothing("d", "no input"),
    )
    agree, statement = agreement(modes)
    assert agree is False
    assert statement.startswith("b disagrees with 2 of the 2 other methods")


def test_a_wide_interval_does_not_disagree() -> None:
    assert agreement((identified_mode("a", 6.0, 0.5), identified_mode("b", 7.0, 0.5, error=0.6)))[0] is True


def test_of_two_methods_neither_is_the_outlier() -> None:
    assert agreement((identified_mode("a", 6.0, 0.5), identified_mode("b", 7.0, 0.5)))[1].startswith(
        "the two methods disagree: "
    )


def test_one_number_alone_is_not_compared() -> None:
    agree, statement = agreement((identified_mode("a", 6.0, 0.5), nothing("b", "no input")))
    assert agree is None
    assert statement == "no comparison: a alone gives a number"


def test_where_no_method_gives_a_number_their_reasons_are_not_repeated() -> None:
    agree, statement = agreement((nothing("a", "gusts"), nothing("b", "no input")))
    assert agree is None
    assert statement == "no comparison: no method gives a number"


def test_times_and_cycles_follow_from_frequency_and_damping() -> None:
    """Malladi's finding: a period of about 1 s and half the amplitude in about 2 s."""
    pair = oscillation(
        "short_period", np.array([6.29, 0.055]), ParameterUncertainty(np.diag([0.01**2, 0.002**2]), 100.0)
    )
    assert isinstance(pair, Oscillation)
    assert pair.period is not None and pair.time_to_half is not None and pair.cycles is not None
    assert pair.period.value == pytest.approx(1.0, abs=0.002)
    assert pair.time_to_half.value == pytest.approx(2.0, abs=0.005)
    assert pair.cycles.value == pytest.approx(pair.time_to_half.value / pair.period.value)
    assert pair.time_to_half.low < 2.0 < pair.time_to_half.high


def test_a_growing_oscillation_has_a_time_to_double_and_a_doubtful_one_neither() -> None:
    spread = np.diag([0.01**2, 0.01**2])
    growing, doubtful = (
        oscillation("phugoid", np.array([0.5, z]), ParameterUncertainty(spread, 50.0)) for z in (-0.05, 0.01)
    )
    assert isinstance(growing, Oscillation) and isinstance(doubtful, Oscillation)
    assert growing.time_to_half is not None
    assert growing.time_to_half.name == "phugoid_time_to_double"
    assert growing.time_to_half.value == pytest.approx(np.log(2) / 0.025)
    assert doubtful.time_to_half is None and doubtful.cycles is None and doubtful.period is not None


def test_pairs_are_split_where_one_is_real() -> None:
    system = np.diag([-8.0, 0.0, 0.0, -2.0])
    system[1:3, 1:3] = [[-0.1, 0.5], [-0.5, -0.1]]
    fast, slow = split_pairs(system)
    np.testing.assert_allclose(sorted(fast.real), [-8.0, -2.0])
    np.testing.assert_allclose(np.abs(slow), np.hypot(0.1, 0.5))
    assert short_period_of(system) == pytest.approx((4.0, 1.25))
