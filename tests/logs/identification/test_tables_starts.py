"""Output error of tables finds its way from starts that noise and gaps would lead elsewhere."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from output_error_cases import LATERAL, LATERAL_TRUTH, simulated, steps
from test_lateral_modes import MAP as LATERAL_MAP
from test_tables_identified import BASE, flight, identified, numbers, write

from logs.identification.results import Array
from logs.identification.sources.table.config import Parameter
from logs.identification.sources.table.run import identify_tables
from wingbeat.errors import InputError

MAP = LATERAL_MAP.replace("[constants]", 'a_y = { column = "a_y", unit = "m/s^2" }\n[constants]').replace(
    "INPUTS", '"delta_a", "delta_r"'
)
FREE = "".join(f'{name} = "free"\n' for name in LATERAL_TRUTH)


def columns(seed: int, noise: float) -> dict[str, Array]:
    time = 0.02 * np.arange(1000)
    inputs = np.column_stack((steps(time, 9.0, 0.3, 0.05), steps(time, 1.0, 0.4, 0.08)))
    record = simulated(LATERAL, LATERAL_TRUTH, inputs, 0.02, noise, seed)
    return {name: record.signals[name] for name in ("beta", "p", "r", "phi", "a_y", "delta_a", "delta_r")}


def coverage(folder: Path, tables: list[dict[str, Array]], outputs: tuple[str, ...]) -> list[bool]:
    """Of all tables, whether each interval holds its truth."""
    (folder / "map.toml").write_text(MAP.replace("OUTPUTS", ", ".join(f'"{one}"' for one in outputs)) + FREE)
    found = []
    for each in tables:
        (fit,) = identify_tables([write(folder / "run.csv", each)], folder / "map.toml", "aero").fits
        assert {one.subject for one in fit.withheld} <= {"spiral"}
        found += [numbers(fit)[name].contains(true) for name, true in LATERAL_TRUTH.items()]
    return found


def test_rates_that_every_fifth_row_lacks_and_a_vane_that_drops_out(tmp_path: Path) -> None:
    """No row has all states with slopes; with starts of zero the fits ended far away, some with the wrong signs."""
    tables = []
    for seed in range(4):
        each = columns(seed, 0.1)
        each["p"][::5] = np.nan
        each["beta"][300:380] = np.nan
        each["phi"][np.random.default_rng(seed).random(1000) < 0.3] = np.nan
        tables.append(each)
    assert np.mean(coverage(tmp_path, tables, ("beta", "p", "r", "phi", "a_y"))) >= 0.85


@pytest.mark.validate
def test_noise_that_hides_the_motion_from_sample_to_sample(tmp_path: Path) -> None:
    """Slopes over 0.1 s are noise; the start that they gave led a fit of the four to a model of next to nothing."""
    tables = [columns(seed, 3.0) for seed in range(4)]
    assert np.mean(coverage(tmp_path, tables, ("beta", "p", "r", "phi", "a_y"))) >= 0.85


@pytest.mark.parametrize("outputs", [("p", "r", "phi"), ("p", "r", "a_y")])
def test_a_sideslip_that_nobody_measured_is_made_of_the_rates(tmp_path: Path, outputs: tuple[str, ...]) -> None:
    tables = [{name: one for name, one in columns(seed, 0.03).items() if name != "beta"} for seed in range(4)]
    mapping = MAP.replace('beta = { column = "beta", unit = "rad" }\n', "")
    assert "beta =" not in mapping
    (tmp_path / "map.toml").write_text(mapping.replace("OUTPUTS", ", ".join(f'"{one}"' for one in outputs)) + FREE)
    found = []
    for each in tables:
        (fit,) = identify_tables([write(tmp_path / "run.csv", each)], tmp_path / "map.toml", "aero").fits
        found += [one.contains(LATERAL_TRUTH[one.name]) for one in fit.estimates]
    assert len(found) >= 36 and np.mean(found) >= 0.85


@pytest.mark.parametrize(("noise", "expected"), [(0.03, False), (0.3, True)])
def test_a_sideslip_that_is_flown_with_its_noise_is_named(tmp_path: Path, noise: float, expected: bool) -> None:
    """As an input its noise is taken for motion: Y_beta came out smaller by as much."""
    mapping = MAP.replace('inputs = ["delta_a"', 'inputs = ["beta", "delta_a"').replace(
        "OUTPUTS", '"p", "r", "phi", "a_y"'
    )
    (tmp_path / "map.toml").write_text(mapping + FREE)
    (fit,) = identify_tables([write(tmp_path / "run.csv", columns(3, noise))], tmp_path / "map.toml", "aero").fits
    said = [one for one in fit.findings if one.code == "noisy_input"]
    assert len(said) == expected
    if expected:
        assert said[0].value == pytest.approx(noise**2 / (1 + noise**2), rel=0.35)
        assert abs(numbers(fit)["Y_beta"].value) < 0.97 * abs(LATERAL_TRUTH["Y_beta"])


@pytest.mark.parametrize(("second", "expected"), [(20.5, False), (26.0, True)])
def test_manoeuvres_at_airspeeds_far_apart_are_named(tmp_path: Path, second: float, expected: bool) -> None:
    mapping = MAP.replace("[constants]\nV = 20.0\n", 'V = { column = "V", unit = "m/s" }\n[constants]\n')
    (tmp_path / "map.toml").write_text(mapping.replace("OUTPUTS", '"beta", "p", "r", "phi", "a_y"') + FREE)
    tables = [
        write(tmp_path / f"{speed}.csv", {**columns(seed, 0.03), "V": np.full(1000, speed)})
        for seed, speed in enumerate((20.0, second))
    ]
    (fit,) = identify_tables(tables, tmp_path / "map.toml", "aero").fits
    said = [one for one in fit.findings if one.code == "operating_point"]
    assert len(said) == expected


@pytest.mark.parametrize(
    ("entry", "message"),
    [("{ low = 1.0, high = 0.0 }", "low must be below high"), ("{ start = 2.0, high = 1.0 }", "start between them")],
)
def test_bounds_that_cannot_hold_are_one_line(entry: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Parameter.from_entry(tomllib.loads(f"a = {entry}")["a"], "modes.parameters.M_q")


def test_bounds_of_a_map_hold(tmp_path: Path) -> None:
    """GIVEN a lower bound above the truth WHEN fitted THEN the parameter stays there and has the finding."""
    free = "".join(f"{name} = {{}}\n" for name in ("Z_alpha", "Z_delta", "M_alpha", "M_delta"))
    mapping = f'{BASE}method = "output_error"\nstates = 2\n[modes.parameters]\n{free}M_q = {{ low = -0.5 }}\n'
    (fit,) = identified(tmp_path, flight(), mapping, "modes").fits
    assert ("at_bound", "M_q") in [(one.code, one.subject) for one in fit.findings]
