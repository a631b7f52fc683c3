"""``wingbeat new-bird``: eight numbers give a vehicle that trims, flies the standard mission and lands."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import pytest

import wingbeat
from groundstation.command.main import main
from sim_bridge.flight.new_vehicle import design_vehicle, write_vehicle
from sim_bridge.vehicles.scaling import NewBird

NUMBERS = {
    "mass": 0.35, "span": 1.0, "area": 0.2, "stroke": 69.0, "rate": 5.0, "tail-area": 0.04, "tail-arm": 0.4,
    "cells": 2, "capacity": 0.8,
}  # fmt: skip
SMALL = NewBird(0.02, 0.3, 0.018, 0.6, 12.0, 0.004, 0.12, 1, 0.15)
LARGE = NewBird(1.5, 2.0, 0.6, 0.6, 3.6, 0.12, 0.8, 4, 2.2)


def words(**changes: float) -> list[str]:
    numbers = NUMBERS | {key.replace("_", "-"): value for key, value in changes.items()}
    return [word for key, value in numbers.items() for word in (f"--{key}", str(value))]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("new") / "my_bird"
    shown = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdout", shown)
        assert main(["new-bird", str(folder), *words(), "--json"]) == 0
    return folder, json.loads(shown.getvalue())


def check_flight(folder: Path, log: Path) -> None:
    """The standard mission is flown and the vehicle lands softly; airspeed and power are near the predicted ones."""
    summary = wingbeat.fly(folder, log=log).summary
    assert summary.landed is not None and summary.touchdown is not None
    assert summary.highest is not None and summary.highest > 39.0
    assert summary.touchdown.sink < 1.5 and abs(summary.touchdown.bank) < 0.5


@pytest.mark.validate
def test_new_bird_predicts_and_is_flown(made: tuple[Path, dict[str, Any]]) -> None:
    _, document = made
    assert document["flies"] and document["flight"]["completed_legs"] == 2
    assert document["cruise"]["airspeed"] == pytest.approx(5.0 * 0.5664 / 0.4226, rel=0.02)
    assert document["cruise"]["airspeed_error"] == pytest.approx(0.14, abs=0.03)
    assert 0.3 < document["efficiency"] < 0.85
    assert [one["code"] for one in document["remarks"]] == [
        "wing_loading", "lift_coefficient", "strouhal", "tail_volume",
    ]  # fmt: skip


@pytest.mark.validate
def test_folder_trims_at_the_given_rate(made: tuple[Path, dict[str, Any]]) -> None:
    folder, document = made
    steady = wingbeat.trim(folder)
    assert steady.orbit.inputs.frequency == pytest.approx(5.0, rel=0.01)
    assert steady.orbit.means.electrical_power == pytest.approx(document["cruise"]["power"], rel=0.01)
    vehicle = wingbeat.load_vehicle(folder)
    assert vehicle.mass == pytest.approx(0.35, rel=1e-3)
    assert vehicle.computer.gains.altitude.pitch_trim == pytest.approx(document["cruise"]["pitch"], rel=1e-3)


@pytest.mark.validate
def test_each_value_is_given_scaled_default_or_tuned(made: tuple[Path, dict[str, Any]]) -> None:
    folder, _ = made
    vehicle = wingbeat.load_vehicle(folder)
    sources = {**vehicle.world.sources, **vehicle.computer.file.sources}
    kinds = {f"{one.kind}: {one.text.split()[0].rstrip(':,')}" for one in sources.values()}
    assert {"chosen: given", "chosen: scaled", "chosen: default", "identified: tuned"} <= kinds
    assert not any(kind.startswith("published") for kind in kinds)
    assert (folder / "world.toml").read_text().count("\n# ") > 15


@pytest.mark.validate
def test_new_bird_flies_the_standard_mission(made: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    check_flight(made[0], tmp_path / "flight.mcap")


@pytest.mark.validate
@pytest.mark.parametrize("bird", [SMALL, LARGE], ids=["20 g", "1.5 kg"])
def test_small_and_large_birds_fly_the_standard_mission(bird: NewBird, tmp_path: Path) -> None:
    vehicle = design_vehicle(bird, "bird")
    assert vehicle.flies
    write_vehicle(vehicle, tmp_path / "bird")
    check_flight(tmp_path / "bird", tmp_path / "flight.mcap")


def test_existing_folder_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "world.toml").write_text("kept")
    assert main(["new-bird", str(tmp_path), *words()]) == 2
    assert "exists" in capsys.readouterr().err
    assert (tmp_path / "world.toml").read_text() == "kept"


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["--mass", "1"], "missing: --span, --area, --stroke, --rate"),
        (words(mass=90.0), "mass = 90 is outside 0.005 to 20 kg"),
        (words(cells=1.5), "--cells 1.5 is not a whole number"),
        (words(mass=-1.0), "-1.0 is not above 0"),
    ],
)
def test_unusable_numbers_are_one_line(
    arguments: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["new-bird", str(tmp_path / "b"), *arguments]) == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


def test_interactive_asks_for_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("0.35\n1.0\n0.2\nmany\n"))
    assert main(["new-bird", str(tmp_path / "b"), "--interactive"]) == 2
    error = capsys.readouterr().err
    assert "all-up mass in kg: " in error and "many is not a number" in error
