"""Malladi's finding: a period of 1 s and half the amplitude in 2 s, found in records at the rate of his modem.

Malladi et al. 2007, section IV.B: hands off for 10 s, 30 to 35 messages a second; omega_n = 6.29 rad/s, zeta = 0.055.
"""

from __future__ import annotations

import numpy as np
import pytest
from promised import SEEDS, covered, modes_kept, pairs

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.nonparametric import modes_of_experiments
from logs.identification.models.modes import Mode, ModesResult
from wingbeat.errors import InputError

FREQUENCY, DAMPING = 6.29, 0.055
RATE = 30.0
QUANTUM = np.radians(1.0)
FINDING = {"short_period_frequency": FREQUENCY, "short_period_damping": DAMPING}
FREE = ("eigensystem realization", "free response", "spectrum")


def glide(seed: int, noise: float = 0.01) -> Experiment:
    """Pitch and angle of attack ringing for 10 s, noisy and rounded to a degree, under a drift."""
    rng = np.random.default_rng(seed)
    time = np.arange(0, 10, 1 / RATE)
    phase = rng.uniform(0, 2 * np.pi)
    swing = np.exp(-DAMPING * FREQUENCY * time)
    turn = FREQUENCY * np.sqrt(1 - DAMPING**2) * time + phase
    pitch = 0.15 * swing * np.cos(turn) + 0.1 + 0.01 * time + noise * rng.normal(size=len(time))
    attack = 0.12 * swing * np.cos(turn - 0.3) + 0.1 + noise * rng.normal(size=len(time))
    signals = {"theta": np.round(pitch / QUANTUM) * QUANTUM, "alpha": np.round(attack / QUANTUM) * QUANTUM}
    return Experiment(f"glide {seed}", time, signals, {"theta": "rad", "alpha": "rad"})


def by_method(seeds: range) -> dict[str, list[Mode]]:
    """Of every seed the mode by each method, refusals too."""
    rows = list(zip(*(modes(seed).modes for seed in seeds), strict=True))
    return {row[0].method: list(row) for row in rows}


def modes(seed: int) -> ModesResult:
    return modes_of_experiments((glide(seed),), None, ("theta", "alpha"))


def test_every_method_that_applies_has_the_finding_in_its_interval() -> None:
    for method, found in by_method(range(4)).items():
        assert all((mode.frequency is not None) == (method in FREE) for mode in found)
        shares = covered([pairs(mode) for mode in found if method in FREE], FINDING)
        assert all(share >= 0.5 for share in shares.values())


@pytest.mark.validate
def test_coverage_of_the_finding() -> None:
    """In at least 95 % of the glides each method gives a number: what noise hides from it is refused."""
    modes_kept("Malladi's glide", [found for method, found in by_method(SEEDS).items() if method in FREE], FINDING)


def test_period_and_time_to_half_are_those_of_the_paper() -> None:
    (pair,) = (mode.short_period for mode in modes(3).modes if mode.method == "free response")
    assert pair is not None and pair.period is not None and pair.time_to_half is not None
    assert pair.period.value == pytest.approx(1.0, abs=0.02)
    assert pair.time_to_half.value == pytest.approx(2.0, abs=0.2)


def test_what_needs_an_input_says_so() -> None:
    missing = modes(0).modes[0]
    assert missing.frequency is None
    assert [entry.text for entry in missing.withheld] == ["the input does not move in the records"]


def test_a_gap_is_bridged_or_cut_and_told() -> None:
    record = glide(1)
    pitch = record.signals["theta"].copy()
    pitch[50:52] = np.nan
    pitch[270:] = np.nan
    result = modes_of_experiments((record._replace(signals={**record.signals, "theta": pitch}),), None, ("theta",))
    assert result.notes == (
        "glide 1: 2 missing samples bridged, the longest stretch without the other 30 taken: 270 of 300 samples",
    )
    (mode,) = (mode for mode in result.modes if mode.method == "free response")
    assert mode.frequency is not None and mode.frequency.value == pytest.approx(FREQUENCY, rel=0.01)


def test_a_signal_that_is_not_there_is_refused_in_one_line() -> None:
    with pytest.raises(InputError, match="no signal 'q'; there are theta, alpha"):
        modes_of_experiments((glide(0),), None, ("q",))
    nothing = np.full(300, np.nan)
    empty = glide(0)._replace(signals={"theta": nothing})
    with pytest.raises(InputError, match="no record of theta has 16 samples"):
        modes_of_experiments((empty,), None, ("theta",))


def test_a_ringing_airspeed_is_the_phugoid() -> None:
    rng = np.random.default_rng(2)
    time = np.arange(0, 60, 0.2)
    speed = 7.5 + 0.8 * np.exp(-0.1 * 0.9 * time) * np.cos(0.9 * time) + 0.05 * rng.normal(size=len(time))
    record = Experiment("glide", time, {"airspeed": speed}, {"airspeed": "m/s"})
    (mode,) = (m for m in modes_of_experiments((record,), None, ("airspeed",)).modes if m.method == "free response")
    assert mode.short_period is None and mode.phugoid is not None
    assert mode.phugoid.frequency.value == pytest.approx(0.9 * np.sqrt(1 + 0.01), rel=0.01)
    assert mode.phugoid.time_to_half is not None
    assert mode.phugoid.time_to_half.name == "phugoid_time_to_half"
    assert mode.phugoid.time_to_half.value == pytest.approx(np.log(2) / 0.09, rel=0.1)
