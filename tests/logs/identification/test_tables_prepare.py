"""[prepare] of a map and its split: late signals found and moved, noise taken off, records thinned and held out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_tables_identified import BASE as MODES
from test_tables_identified import TRUTH, flight, motion, write

from groundstation.command.main import main

RATE, LATE = 100.0, 0.08
BASE = MODES.replace("[modes]", '[[aero.output_error]]\nmodel = "short period"')


def table(folder: Path, name: str = "run.csv", seed: int = 1, late: float = 0.0) -> Path:
    """A 3-2-1-1 at 100 Hz whose vane is late; a second gyro tells the pitch rate in other units."""
    t, states, delta = motion(RATE, 15.0, 1.0)
    rng = np.random.default_rng(seed)
    a_z = 100.0 * (TRUTH["Z_alpha"] * states[:, 0] + TRUTH["Z_delta"] * delta) - 9.80665
    alpha = np.interp(t - late, t, states[:, 0]) + 0.05
    noise = {"alpha": 0.002, "q": 0.003, "a_z": 0.1, "q2": 0.2}
    clean = {
        "alpha": alpha,
        "q": states[:, 1],
        "a_z": a_z,
        "q2": np.degrees(np.interp(t - late, t, states[:, 1])) + 4,
    }
    columns = {n: v + rng.normal(0, noise[n], len(t)) for n, v in clean.items()}
    return write(folder / name, {"t": t, **columns, "delta_e": delta - 0.02})


def documented(
    folder: Path, capsys: pytest.CaptureFixture[str], files: list[Path], more: str, base: str = BASE
) -> dict[str, Any]:
    (folder / "map.toml").write_text(base + more)
    assert main(["identify", *map(str, files), "aero", "--map", str(folder / "map.toml"), "--json"]) == 0
    document: dict[str, Any] = json.loads(capsys.readouterr().out)
    return document


def errors(document: dict[str, Any]) -> dict[str, float]:
    """Distance of output error's derivatives from the truth, of the truth."""
    return {one["name"]: abs(one["value"] / TRUTH[one["name"]] - 1) for one in document["fits"][0]["estimates"]}


def test_a_late_signal_is_found_by_another_and_moved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a recorder whose gyro and vane are late THEN its gyro tells by how much, and the vane is moved by it."""
    base = BASE.replace("[constants]", 'q2 = { column = "q2", unit = "deg/s" }\n[constants]')
    files = [table(tmp_path, late=LATE)]
    asked = f'[prepare.delay]\nq2 = {{ like = "q", longest = 1.0 }}\nalpha = {LATE}\n'
    document = documented(tmp_path, capsys, files, asked, base)
    (delay,) = document["delays"]
    assert delay["name"] == "q2" and delay["unit"] == "s"
    assert abs(delay["value"] - LATE) < 2 * (delay["high"] - delay["value"]) < 0.01
    assert any(note.startswith("q2 is 0.08") and "late behind q" in note for note in document["notes"])
    moved = errors(document)
    plain = errors(documented(tmp_path, capsys, files, "", base))
    assert max(moved.values()) < 0.04
    assert plain["M_alpha"] > 2 * moved["M_alpha"] or plain["Z_alpha"] > 2 * moved["Z_alpha"]


def test_an_angle_is_put_in_place_by_its_slope(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t, states, _ = motion(RATE, 15.0, 1.0)
    theta = np.concatenate(([0.0], np.cumsum(states[1:, 1] + states[:-1, 1]) / 2 / RATE))
    rng, columns = np.random.default_rng(3), flight(RATE)
    columns["theta"] = np.interp(t - LATE, t, theta) + 0.001 * rng.normal(size=len(t))
    base = BASE.replace("[constants]", 'theta = { column = "theta", unit = "rad" }\n[constants]')
    asked = '[prepare.delay]\ntheta = { like = "q", by = "slope" }\n'
    (delay,) = documented(tmp_path, capsys, [write(tmp_path / "run.csv", columns)], asked, base)["delays"]
    assert delay["low"] - 0.002 <= LATE <= delay["high"] + 0.002


def test_smoothing_and_resampling_leave_the_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    asked = '[prepare]\nresample = 25.0\nsmooth = { alpha = "fourier", q = "spline" }\n'
    document = documented(tmp_path, capsys, [table(tmp_path)], asked)
    assert max(errors(document).values()) < 0.06
    # Smoothing takes the noise of high frequencies off: the variance of M_alpha came out negative once.
    assert not document["fits"][0]["unidentified"]
    notes = " ".join(document["notes"])
    assert "alpha smoothed by fourier, noise of 0.00" in notes and "100 Hz low-passed and resampled to 25 Hz" in notes
    assert document["fits"][0]["samples"] == 365  # of 375: the low-pass takes five at either end


def test_files_and_shares_are_held_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = [table(tmp_path, name, seed) for seed, name in enumerate(("a.csv", "b.csv", "c.csv"))]
    named = documented(tmp_path, capsys, files, '[maneuvers]\nvalidate_files = ["b.csv"]\n')
    assert named["manoeuvres"]["held_out"] == ["maneuver 2 of b.csv"]
    drawn = documented(tmp_path, capsys, files, "[maneuvers]\nvalidation_fraction = 0.34\n")
    (held,) = drawn["manoeuvres"]["held_out"]
    assert f"held out: 1 of 3 flights ({held.partition(' of ')[2]})" in drawn["notes"]
    thiels = [one["theil"] for one in drawn["fits"][0]["outputs"] if one["held_out"]]
    assert len(thiels) == 3 and max(thiels) < 0.1


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ("[prepare.delay]\nalfa = 0.1\n", "prepare.delay.alfa (meant 'alpha'?)"),
        ('[prepare.delay]\nalpha = { like = "Q" }\n', "prepare.delay.alpha.reference Q"),
        ('[prepare.delay]\nalpha = { lik = "q" }\n', "prepare.delay.alpha.lik"),
        ('[prepare.delay]\nalpha = { like = "delta_e", longest = 20 }\n', "skew behind delta_e is not determined"),
        ('[prepare]\nsmooth = { alpha = "splin" }\n', "prepare.smooth.alpha = 'splin' is not known; known: local"),
        ("[prepare]\nresample = 500\n", "prepare.resample = 500 Hz is not above 0 and up to the 25 Hz"),
        ('[maneuvers]\nvalidate_files = ["rn.csv"]\n',
         "maneuvers.validate_files rn.csv (meant 'run.csv'?): no such file is among those given; there are: run"),
        ("[maneuvers]\nvalidation_fraction = 0.5\n", "a single maneuver cannot be split"),
        ("[maneuvers]\nvalidation_fraction = 0.5\nvalidate = [1]\n", "maneuvers.validation_fraction draws"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_in_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: str, expected: str
) -> None:
    (tmp_path / "map.toml").write_text(BASE + more)
    file = write(tmp_path / "run.csv", flight())
    assert main(["identify", str(file), "aero", "--map", str(tmp_path / "map.toml")]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line
