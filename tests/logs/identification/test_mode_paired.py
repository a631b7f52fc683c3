"""What is no mode, though a method found a frequency: a motion that does not decay, and two pairs that turn alike."""

from __future__ import annotations

import numpy as np
import pytest

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.nonparametric import modes_of_experiments
from logs.identification.models.modes import (
    FORCED,
    HEAVY,
    KINDS,
    PHUGOID,
    SHORT_PERIOD,
    Mode,
    mode_of_system,
    paired_mode,
    without_heavy,
)
from logs.identification.statistics.covariance import ParameterUncertainty


def identified(pairs: list[float], errors: list[float], kinds: tuple[str, ...] = KINDS) -> Mode:
    return paired_mode(
        "free response", kinds, np.array(pairs), ParameterUncertainty(np.diag(np.square(errors)), 100.0)
    )


@pytest.mark.parametrize("damping", [0.005, -0.002, 0.0])
def test_a_motion_that_does_not_decay_is_no_short_period(damping: float) -> None:
    """GIVEN wings that shake the body WHEN a method is sure of their frequency THEN it is not told as the mode."""
    mode = identified([29.5, damping], [0.1, 0.01], (SHORT_PERIOD,))
    assert mode.frequency is None
    assert [one.text for one in mode.withheld] == [FORCED]


@pytest.mark.parametrize("damping", [0.055, -0.05])
def test_one_that_surely_decays_or_grows_is(damping: float) -> None:
    mode = identified([6.28, damping], [0.1, 0.01], (SHORT_PERIOD,))
    assert mode.frequency is not None and mode.damping is not None and mode.damping.value == damping


def test_a_phugoid_may_last() -> None:
    mode = identified([3.8, 0.6, 0.2, 0.0], [0.1, 0.1, 0.01, 0.01])
    assert mode.short_period is not None and mode.phugoid is not None


def test_pairs_that_turn_alike_are_parts_of_one_motion() -> None:
    mode = identified([0.2, 0.06, 0.24, 0.3], [0.001, 0.01, 0.01, 0.05])
    assert mode.short_period is None and mode.phugoid is None
    assert {one.subject for one in mode.withheld} == {SHORT_PERIOD, PHUGOID}
    assert all("not told apart" in one.text for one in mode.withheld)


def test_a_phugoid_that_may_be_heavily_damped_takes_no_short_period_with_it() -> None:
    mode = without_heavy(identified([3.8, 0.2, 0.2, 0.3], [0.1, 0.01, 0.01, 0.1]), 0.4)
    assert mode.short_period is not None and mode.phugoid is None
    assert [(one.subject, one.text) for one in mode.withheld] == [(PHUGOID, HEAVY)]


def test_a_short_period_that_may_be_leaves_no_mode() -> None:
    mode = without_heavy(identified([3.8, 0.3, 0.2, 0.1], [0.1, 0.1, 0.01, 0.01]), 0.4)
    assert mode.short_period is None and mode.phugoid is None
    assert [one.text for one in mode.withheld] == [HEAVY, HEAVY]


def unstable(parameters: np.ndarray) -> np.ndarray:
    """Two states, the elements of their matrix as parameters."""
    return parameters.reshape(2, 2)


def test_an_unstable_aircraft_tells_the_time_in_which_its_motion_doubles() -> None:
    """GIVEN real roots of both signs THEN they are told, with the errors that drawn matrices scatter by."""
    values, spread = (
        np.array([-1.4, 1.0, 12.0, -3.7]),
        ParameterUncertainty(np.diag(np.square([0.05, 0.0, 0.2, 0.1])), 1e6),
    )
    mode = mode_of_system("output error", unstable, values, spread)
    assert mode.short_period is None and "a divergence" in mode.withheld[0].text
    double, decay = mode.divergence
    slow, fast = np.sort(np.linalg.eigvals(unstable(values)).real)[::-1]
    assert double.value == pytest.approx(np.log(2) / slow) and decay.value == pytest.approx(-1 / fast)
    drawn = np.random.default_rng(1).multivariate_normal(values, spread.covariance, 4000)
    roots = np.sort(np.linalg.eigvals(drawn.reshape(-1, 2, 2)).real, axis=1)
    assert np.quantile(np.log(2) / roots[:, 1], [0.025, 0.975]) == pytest.approx([double.low, double.high], rel=0.05)
    assert np.quantile(-1 / roots[:, 0], [0.025, 0.975]) == pytest.approx([decay.low, decay.high], rel=0.05)


def test_what_may_not_grow_has_no_time_to_double() -> None:
    nearly = np.array([-1.0, 1.0, 1.51, -1.5])
    sure = mode_of_system("output error", unstable, nearly, ParameterUncertainty(np.diag(np.full(4, 1e-8)), 1e6))
    unsure = mode_of_system("output error", unstable, nearly, ParameterUncertainty(np.diag(np.full(4, 1e-2)), 1e6))
    assert len(sure.divergence) == 2 and unsure.divergence == ()
    stable = mode_of_system(
        "output error", unstable, np.array([-1.0, 1.0, -4.0, -1.5]), ParameterUncertainty(np.eye(4) * 1e-6, 1e6)
    )
    assert stable.short_period is not None and stable.divergence == ()


def test_a_ring_down_that_may_be_damped_heavily_gives_no_number() -> None:
    """GIVEN a damping of 0.45 beside a slow swing, which took twelve of twelve below 0.4, outside their intervals."""
    told = []
    for seed in range(12):
        rng, time = np.random.default_rng(seed), np.arange(0.0, 8.0, 0.04)
        wave = np.exp(-0.45 * 2.5 * time) * np.cos(2.5 * np.sqrt(1 - 0.45**2) * time)
        pitch = 0.1 * wave + 0.03 * np.cos(0.6 * time) + 0.002 * rng.normal(size=len(time))
        one = Experiment("ring", time, {"theta": pitch}, {"theta": "rad"})
        identified = {mode.method: mode for mode in modes_of_experiments((one,), None, ("theta",)).modes}
        told.append(identified["free response"].damping)
    assert all(one is None or one.high <= 0.4 for one in told)
    assert sum(one is not None for one in told) <= 3
