"""Scaling of a vehicle by units, and the laws of published flights."""

from __future__ import annotations

import math
import tomllib

import pytest

from sim_bridge.vehicles import FOLDER, SCHEMA, load_vehicle
from sim_bridge.vehicles.published_flights import FLIGHTS, predict
from sim_bridge.vehicles.scaling import (
    Cruise,
    NewBird,
    Ratios,
    Reference,
    law_of,
    ratios_of,
    remarks,
    scaled,
    world_document,
)
from wingbeat.documents import toml_text
from wingbeat.errors import InputError
from wingbeat.vehicle_file import read_vehicle_file

ARIZONA = tomllib.loads(load_vehicle("arizona_100cm").text)
REFERENCE = Reference(ARIZONA, 8.0, 3.2, 32.0)
SAME = NewBird(REFERENCE.mass, 1.0, 0.1 * math.pi / 2.0, 0.6, 3.2, 0.03, 0.4, 2, 0.74)
RATIOS = Ratios(2.0, 3.0, 1.5, 0.5, 2.0, 2.0, 4.0, 6.0, 1.5)


def test_ratios_to_itself_are_one() -> None:
    assert ratios_of(SAME, Cruise(8.0, 32.0), REFERENCE) == pytest.approx((1.0,) * 9)


def test_document_scaled_to_itself_keeps_its_values(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """GIVEN the numbers of the reference WHEN scaled THEN bodies, wings, tail and drive are the same."""
    path = tmp_path / "same.toml"
    path.write_text(toml_text(world_document(SAME, Cruise(8.0, 32.0), REFERENCE, "same")))
    old, new = load_vehicle("arizona_100cm"), load_vehicle(str(path))
    for name, body in old.bodies.items():
        for field in ("mass", "place", "center", "inertia", "damping"):
            assert getattr(new.bodies[name], field) == pytest.approx(getattr(body, field), rel=2e-3, abs=2e-5), field
    assert new.drive.frequencies == pytest.approx(old.drive.frequencies, rel=1e-3)
    for field in ("semispan", "root_chord", "membrane_mass", "twist_stiffness"):
        assert getattr(new.wing, field) == pytest.approx(getattr(old.wing, field), rel=1e-3), field
    assert new.plates == old.plates


@pytest.mark.parametrize(
    ("unit", "section", "factor"),
    [
        ("m", "fuselage", 2.0), ("kg m^2", "bodies", 3.0 * 4.0), ("N m/rad", "drive", 6.0),
        ("s", "tail_servo", 2.0 / 1.5),
        ("rad/s", "drive", 2.0), ("s", "drive", 0.5), ("m", "navigation", 2.25), ("s/m", "altitude", 1.5 / 2.25),
        ("m/s^2", "altitude", 1.0), ("A", "drive", 4.0), ("Hz", "drive", 2.0), ("Hz", "ahrs_filter", 1.0),
        ("-", "wing", 1.0), ("gauss", "ahrs", 1.0),
    ],
)  # fmt: skip
def test_law_of_unit(unit: str, section: str, factor: float) -> None:
    """Gravity is the same: accelerations of the path keep, forces go with the mass."""
    assert law_of(unit, section, RATIOS)[0] == pytest.approx(factor)


def test_every_scaled_value_has_its_law_and_every_other_its_default() -> None:
    document = scaled(ARIZONA, RATIOS, "arizona_100cm")
    sources = [entry["source"] for table in document.values() if isinstance(table, dict)
               for entry in table.values() if isinstance(entry, dict) and "value" in entry]  # fmt: skip
    assert len(sources) > 50
    assert all(one.startswith(("chosen: scaled from arizona_100cm by ", "chosen: default")) for one in sources)


def test_unusual_numbers_are_remarked() -> None:
    bird = FLIGHTS["Slow Hawk"].bird
    assert not any(one.unusual for one in remarks(bird, 9.2, 1.225))
    heavy = {one.code for one in remarks(bird._replace(mass=20.0, tail_area=0.001), 9.2, 1.225) if one.unusual}
    assert heavy == {"wing_loading", "lift_coefficient", "tail_volume"}


def test_wings_and_tail_heavier_than_the_vehicle_are_refused() -> None:
    heavy_wings = Reference({**ARIZONA, "wing": {**ARIZONA["wing"], "membrane_mass": {"value": 0.2}}}, 8.0, 3.2, 32.0)
    with pytest.raises(InputError, match="leave"):
        world_document(SAME._replace(mass=REFERENCE.mass), Cruise(8.0, 32.0), heavy_wings, "x")


def test_written_document_is_read_back(tmp_path) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "bird.toml"
    bird = NewBird(0.02, 0.3, 0.018, 0.6, 12.0, 0.004, 0.12, 1, 0.15)
    path.write_text(toml_text(world_document(bird, Cruise(4.8, 1.1), REFERENCE, "bird")))
    file = read_vehicle_file(path, SCHEMA, FOLDER)
    assert file.sections["wing"].semispan == 0.15


@pytest.mark.parametrize("name", FLIGHTS)
def test_published_flight_is_predicted_without_itself(name: str) -> None:
    """Cruise within 15 % but for wing B, whose Strouhal number of 0.52 is beside the others; power within 30 %."""
    flight = FLIGHTS[name]
    found = predict(flight.bird, without=name)
    error = found.airspeed / flight.airspeed - 1.0
    assert (abs(error) < 0.15) == (name != "Robo Raven II, wing B"), error
    if flight.power is not None:
        assert found.power == pytest.approx(flight.power, rel=0.3)
