"""The course of an input between its samples is reported and in the intervals if it changes the estimates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.logs.identification.test_tables_identified import (
    BASE,
    TRUTH,
    codes,
    identified,
    motion_of,
    numbers,
    slowed,
)

FINE = 500.0
EDGES = np.array([1.03, 2.11, 2.83, 3.19, 3.55])
LEVELS = np.radians([0.0, 3.0, -3.0, 3.0, -3.0, 0.0])


def ramped(rate: float, width: float, noise: float, scale: float = 1.0) -> dict[str, np.ndarray]:
    """A 3-2-1-1 whose ramps of ``width`` s have their corners between samples; the motion ``scale`` times as slow."""
    t = np.arange(0.0, 15.0 * scale, 1.0 / FINE)
    ramps = [by * np.clip((t - scale * edge) / width, 0, 1) for edge, by in zip(EDGES, np.diff(LEVELS), strict=True)]
    _, states, delta = motion_of(t, np.sum(ramps, axis=0), 1.0 / FINE, scale)
    every = round(FINE / rate)
    t, states, delta = t[::every], states[::every], delta[::every]
    rng, p = np.random.default_rng(5), slowed(scale)
    force = 100.0 * (p["Z_alpha"] * states[:, 0] + p["Z_delta"] * delta) - 9.80665
    clean = {"alpha": states[:, 0] + 0.05, "q": states[:, 1], "a_z": force}
    sizes = {"alpha": 0.002, "q": 0.003 / scale, "a_z": 0.1 / scale}
    noisy = {name: one + noise * rng.normal(0.0, sizes[name], len(t)) for name, one in clean.items()}
    return {"t": t, **noisy, "delta_e": delta}


@pytest.mark.parametrize(
    ("rate", "width", "noise", "scale", "expected"),
    [
        (10.0, 0.2, 0.3, 1.0, True),
        pytest.param(25.0, 0.08, 0.3, 1.0, True, marks=pytest.mark.validate),
        pytest.param(10.0, 0.4, 1.0, 6.0, False, marks=pytest.mark.validate),
        (50.0, 0.06, 1.0, 1.0, False),
    ],
)
def test_a_course_that_the_samples_do_not_show_is_named_where_it_puts_numbers_off(
    tmp_path: Path, rate: float, width: float, noise: float, scale: float, expected: bool
) -> None:
    """GIVEN an input that moves by a fifth of its range between samples THEN the intervals hold the truth."""
    columns = ramped(rate, width, noise, scale)
    assert np.max(np.abs(np.diff(columns["delta_e"]))) > 0.2 * np.ptp(columns["delta_e"])
    fit = identified(tmp_path, columns, BASE).fits[0]
    assert ("sampling" in codes(fit)) is expected
    truth, found = slowed(scale), numbers(fit)
    off = max(abs(found[name].value - truth[name]) / found[name].standard_error for name in TRUTH)
    assert off < 2.2, off
