"""What a table leaves out, and its residuals tell: a delay, a channel that is late, a vane ahead of the centre."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from output_error_cases import LATERAL, LATERAL_TRUTH, simulated, steps
from test_tables_identified import BASE, flight, identified, write
from test_tables_starts import FREE
from test_tables_starts import MAP as LATERAL_MAP

from logs.identification.findings import Finding
from logs.identification.results import Array, EstimationResult
from logs.identification.sources.table.run import identify_tables

Columns = dict[str, Array]


def later(values: Array, samples: int) -> Array:
    return np.concatenate((np.full(samples, values[0]), values[:-samples]))


OMITTED = {"time_skew", "sensor_position", "model_structure"}


def effects(fit: EstimationResult) -> list[Finding]:
    return [one for one in fit.findings if one.code in OMITTED]


def effects_of(folder: Path, change: Callable[[Columns], None], noise: float = 1.0) -> list[Finding]:
    columns = {name: np.array(values) for name, values in flight(25.0, noise=noise).items()}
    change(columns)
    (fit,) = identified(folder, columns, BASE).fits
    return effects(fit)


def test_an_input_that_acts_late_is_found_with_its_delay(tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        for name in ("alpha", "q", "a_z"):
            columns[name] = later(columns[name], 3)

    (note,) = effects_of(tmp_path, change)
    assert (note.code, note.subject) == ("time_skew", "delta_e")
    assert note.value == pytest.approx(0.12, rel=0.25)


def test_a_channel_that_is_late_is_named(tmp_path: Path) -> None:
    def change(columns: Columns) -> None:
        columns["alpha"] = later(columns["alpha"], 3)

    (note,) = effects_of(tmp_path, change)
    assert (note.code, note.subject) == ("time_skew", "alpha")
    assert note.value == pytest.approx(0.12, rel=0.25)


@pytest.mark.parametrize("place", [12.0, pytest.param(-12.0, marks=pytest.mark.validate)])
def test_a_vane_off_the_centre_is_found_with_its_place(tmp_path: Path, place: float) -> None:
    """Of an airspeed of 100 m/s; the specific force contradicts it."""

    def change(columns: Columns) -> None:
        columns["alpha"] = columns["alpha"] - place * columns["q"] / 100.0

    (note,) = effects_of(tmp_path, change, noise=0.3)
    assert (note.code, note.subject) == ("sensor_position", "alpha")
    assert note.value == pytest.approx(place, rel=0.3)


@pytest.mark.validate
@pytest.mark.parametrize("kind", ["white", "slow"])
def test_noise_of_any_colour_is_none_of_these(tmp_path: Path, kind: str) -> None:
    for seed in range(3):

        def change(columns: Columns, seed: int = seed) -> None:
            rng = np.random.default_rng(seed)
            for name, size in (("alpha", 0.004), ("q", 0.006), ("a_z", 0.2)):
                drawn = rng.normal(size=len(columns["t"]))
                slow = np.convolve(drawn, np.exp(-np.arange(40) / 10.0))[: len(drawn)]
                columns[name] = columns[name] + size * (drawn if kind == "white" else slow / slow.std())

        assert effects_of(tmp_path, change) == []


@pytest.mark.parametrize("true", [0.0, 4.0])
def test_a_derivative_that_the_map_leaves_out_is_named_with_its_size(tmp_path: Path, true: float) -> None:
    """Y_r counts as zero unless it is named; the derivatives beside it take what they can of it."""
    time = 0.02 * np.arange(1000)
    inputs = np.column_stack((steps(time, 9.0, 0.3, 0.05), steps(time, 1.0, 0.4, 0.08)))
    record = simulated(LATERAL, {**LATERAL_TRUTH, "Y_r": true}, inputs, 0.02, 0.02, 1)
    columns = {name: record.signals[name] for name in ("beta", "p", "r", "phi", "a_y", "delta_a", "delta_r")}
    outputs = ", ".join(f'"{name}"' for name in ("beta", "p", "r", "phi", "a_y"))
    (tmp_path / "map.toml").write_text(LATERAL_MAP.replace("OUTPUTS", outputs) + FREE)
    (fit,) = identify_tables([write(tmp_path / "run.csv", columns)], tmp_path / "map.toml", "aero").fits
    notes = effects(fit)
    assert len(notes) == (true > 0.0)
    if notes:
        assert (notes[0].code, notes[0].subject) == ("model_structure", "Y_r")
        assert notes[0].value == pytest.approx(true, rel=0.3)
