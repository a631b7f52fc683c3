from __future__ import annotations

import re
from pathlib import Path

import pytest
from plant_bench import NAMES

from avionics.quantities import BadInput
from sim_bridge.vehicles import FOLDER, load_vehicle, vehicle_names

RAVEN = (FOLDER / "robo_raven_ii_d.toml").read_text(encoding="utf-8")


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "bird.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def changed(key: str, value: str, section: str = "") -> str:
    """The file of Robo Raven with another value for the first ``key`` of ``section``."""
    head, mark, rest = RAVEN.partition(f"[{section}]") if section else ("", "", RAVEN)
    new, count = re.subn(
        rf"(?m)^{key} = \{{ value = (\[[^\]]*\]|[^,]+)", f"{key} = {{ value = {value}", rest, count=1
    )
    assert count == 1
    return head + mark + new


def without(key: str) -> str:
    text, count = re.subn(rf"(?m)^{key} = .*\n", "", RAVEN, count=1)
    assert count == 1
    return text


def test_the_folder_holds_the_known_vehicles() -> None:
    assert set(NAMES) <= set(vehicle_names())


@pytest.mark.parametrize("name", vehicle_names())
def test_every_value_of_every_vehicle_has_a_source(name: str) -> None:
    vehicle = load_vehicle(name)
    keys = {f"{section}.{key}" for section, values in vehicle.sections.items() for key in values._fields}
    assert set(vehicle.sources) == keys
    assert vehicle.name == name
    assert all(source.text for source in vehicle.sources.values())
    assert all(vehicle.sources[key].kind == "chosen" for key in vehicle.fitted)


def test_a_file_is_loaded_by_its_path(tmp_path: Path) -> None:
    vehicle = load_vehicle(written(tmp_path, changed("semispan", "0.5")))
    assert vehicle.wing.semispan == 0.5


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (without("semispan"), r"wing\.semispan is missing \(0\.005 to 5 m\)"),
        (
            RAVEN.replace("[wing]", '[wing]\nfeathers = { value = 9, unit = "-", source = "chosen: no" }'),
            "wing.feathers",
        ),
        (changed("semispan", "9.0"), r"wing\.semispan.*0\.005.*5"),
        (changed("semispan", "nan"), r"wing\.semispan"),
        (changed("semispan", '"long"'), r"wing\.semispan"),
        (changed("strips", "3"), r"wing\.strips.*4.*60"),
        (changed("planform", '"delta"'), r'planform = "delta" must be "raven" or "ellipse"'),
        (changed("kind", '"rubber band"', "drive"), r'drive\.kind = "rubber band" must be'),
        (changed("frequencies", "[1.0]"), r"drive\.frequencies must have at least 2"),
        (changed("mass", "0.04", "body"), r"body\.mass = 0\.04 kg must exceed"),
        (RAVEN.replace('value = 0.762, unit = "m"', 'value = 762, unit = "mm"'), r"wing\.semispan"),
        (RAVEN.replace("published: Gerdes Table 3, wing D; the", "rumour: the"), r"wing\.semispan"),
        (RAVEN.replace("[tail]", "[tial]"), "tial"),
        ("not = [valid", "not valid TOML"),
        ("", "section .* is missing"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_key_and_range(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(BadInput, match=said) as refused:
        load_vehicle(written(tmp_path, text))
    assert "\n" not in str(refused.value)


def test_an_unknown_vehicle_is_told_the_known_ones() -> None:
    with pytest.raises(BadInput, match=r"unknown vehicle 'pterodactyl'; known: .*robo_raven_ii_d"):
        load_vehicle("pterodactyl")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"gone\.toml"):
        load_vehicle(str(tmp_path / "gone.toml"))
