"""A flight test flown again: a model's file, the world that is made of it, and what that world is linearised to."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from sim_bridge.flight_mechanics.averaged import stroke_averaged_model
from sim_bridge.flight_mechanics.averaged_axes import axes_model
from sim_bridge.flight_mechanics.identified import identified_world, world_text
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.tuning.model import Identified, IdentifiedValue, LinearModel, load_model, model_text, save_model
from sim_bridge.vehicles import SimulatedVehicle, load_vehicle
from wingbeat.errors import InputError

MODELS = Path(__file__).parents[1] / "data" / "models"
ESTIMATES = (
    IdentifiedValue("X_u", "1/s", -0.48, 0.05, -0.58, -0.38),
    IdentifiedValue("short_period_frequency", "rad/s", 9.88, 0.1, 9.68, 10.08),
)


def flight_test(lateral: bool = True) -> LinearModel:
    """A model as of a flight test: Robo Raven's, slower in pitch than that vehicle is."""
    model = load_model(MODELS / "robo_raven_ii_d.toml")
    a = model.a.copy()
    a[2, 1] *= 0.6
    found = Identified("flight.mcap", "0f" * 32, "output error", -0.03, model.pitch, 1.225, ESTIMATES)
    model = model._replace(a=a, identified=found, vehicle="")
    return model if lateral else model._replace(lateral=None, drive=None)


def written(model: LinearModel, folder: Path) -> SimulatedVehicle:
    """The world of the model on Robo Raven's bodies, from its file."""
    world = identified_world(model, load_vehicle("robo_raven_ii_d"))
    path = folder / "world.toml"
    path.write_text(world_text(world, "again", "flown again", "robo_raven_ii_d"), encoding="utf-8")
    return load_vehicle(str(path))


def roots(matrix: np.ndarray) -> list[complex]:
    return sorted(map(complex, np.linalg.eigvals(matrix)), key=lambda root: (abs(root), root.imag))


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> SimulatedVehicle:
    return written(flight_test(), tmp_path_factory.mktemp("world"))


def test_the_trim_search_starts_near_the_trim(world: SimulatedVehicle) -> None:
    """GIVEN an identified vehicle THEN the amplitude its trim search starts with is that of its trim."""
    assert world.cruise.airspeed == pytest.approx(load_model(MODELS / "robo_raven_ii_d.toml").airspeed, rel=1e-3)
    found = trim(world, world.cruise.airspeed, 0.0)
    assert found.inputs.amplitude == pytest.approx(world.cruise.stroke_amplitude, rel=0.15)


def test_a_model_keeps_its_flight_test_through_its_file(tmp_path: Path) -> None:
    path = tmp_path / "bird.toml"
    save_model(path, flight_test())
    assert load_model(path).identified == flight_test().identified
    assert model_text(load_model(path)) == path.read_text(encoding="utf-8")


def test_the_vehicle_of_a_model_is_the_folder_beside_it_where_there_is_one(tmp_path: Path) -> None:
    path = tmp_path / "bird.toml"
    save_model(path, flight_test()._replace(vehicle="bird"))
    assert load_model(path).vehicle == "bird"
    (tmp_path / "bird").mkdir()
    assert load_model(path).vehicle == str(tmp_path / "bird")


@pytest.mark.parametrize(
    ("old", "new", "stated"),
    [
        ('log = "flight.mcap"\n', "", "identified.log is missing"),
        ("elevator = -0.03", "elevator = nan", "identified.elevator must be a finite number, not nan"),
        ("density = 1.225", "density = 0.0", "identified.density = 0 must be above 0 kg/m^3"),
        ("low = -0.58\n", "", "identified.estimates.X_u.low is missing"),
        (
            "low = -0.58\n",
            "low = -0.4\n",
            "identified.estimates.X_u.value = -0.48 is outside its interval, -0.4 to -0.38 1/s",
        ),
        ('method = "output error"', "method = 3", "identified.method must be text"),
        (
            "angle_of_attack",
            "attack",
            "unknown key identified.attack; known: log, sha256, method, elevator, angle_of_attack",
        ),
    ],
)
def test_a_section_that_cannot_be_used_is_refused_in_a_line(tmp_path: Path, old: str, new: str, stated: str) -> None:
    path, text = tmp_path / "bird.toml", model_text(flight_test())
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        load_model(path)
    assert str(refused.value).startswith(f"{path}: {stated}") and "\n" not in str(refused.value)


def test_a_model_of_no_flight_test_makes_no_world() -> None:
    with pytest.raises(InputError, match=r"of no flight test: it has no section \[identified\]$"):
        identified_world(flight_test()._replace(identified=None), load_vehicle("robo_raven_ii_d"))


def test_the_world_has_the_modes_of_the_model_that_it_is_made_of(world: SimulatedVehicle) -> None:
    """Wings that flap with their inertia, a centre of mass that moves: the average is the model's to a percent."""
    model = flight_test()
    orbit = trim(world, model.airspeed, 0.0)
    assert orbit.means.pitch == pytest.approx(model.pitch, abs=0.01)
    assert orbit.inputs.elevator == pytest.approx(-0.03, abs=0.01)
    for ours, theirs in zip(roots(stroke_averaged_model(world, orbit).a), roots(model.a), strict=True):
        assert abs(ours - theirs) < 0.02 * abs(theirs)


def test_every_number_of_the_world_says_where_it_is_from(world: SimulatedVehicle) -> None:
    sources = {key.removeprefix("derivatives."): s for key, s in world.sources.items() if key.startswith("deriv")}
    assert sources["x_u"].kind == "identified" and "standard error 0.05" in sources["x_u"].text
    assert sources["mass"].kind == "chosen" and "robo_raven_ii_d" in sources["mass"].text
    assert sources["n_r"].kind == "identified"
    assert world.sections["derivatives"].mass == pytest.approx(0.359, rel=1e-3)
    assert not world.wing.twists and world.cruise.airspeed == pytest.approx(6.8)


@pytest.mark.validate
def test_what_was_not_identified_is_the_bases_own_and_said_to_be(tmp_path: Path) -> None:
    model, whole = flight_test(lateral=False), flight_test()
    found = identified_world(model, load_vehicle("robo_raven_ii_d"))
    assert [note.partition(":")[0] for note in found.notes] == [
        "lateral derivatives of the world",
        "drive of the world",
    ]
    assert all(found.sources[key].startswith("chosen: not identified") for key in ("y_v", "l_p", "x_drive"))
    vehicle = written(model, tmp_path)
    orbit = trim(vehicle, model.airspeed, 0.0)
    axes = axes_model(vehicle, orbit, stroke_averaged_model(vehicle, orbit))
    assert whole.lateral is not None and whole.drive is not None
    for ours, theirs in zip(roots(axes.lateral), roots(whole.lateral.a), strict=True):
        assert abs(ours - theirs) < 0.05 * abs(theirs)
    assert axes.drive[:3] == pytest.approx(whole.drive.b[:3], rel=0.1)
    assert math.isfinite(axes.drive_lag)
