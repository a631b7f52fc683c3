from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from plant_bench import NAMES

from avionics.vehicles import load_vehicle as load_flight_vehicle
from avionics.vehicles import vehicle_names as flight_names
from groundstation.command.main import main
from sim_bridge.mechanism import CHANNELS, all_parts, build_mechanism, total_mass
from sim_bridge.vehicles import FOLDER, REPEATED, load_vehicle, vehicle_bodies, vehicle_names, with_model
from sim_bridge.vehicles.bodies import MOVERS
from wingbeat.documents import toml_text
from wingbeat.errors import InputError

RAVEN = (FOLDER / "robo_raven_ii_d.toml").read_text(encoding="utf-8")


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "bird.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def changed(key: str, value: str, section: str = "") -> str:
    """The file of Robo Raven with another value, or name, for the first ``key`` of ``section``."""
    head, mark, rest = RAVEN.partition(f"[{section}]") if section else ("", "", RAVEN)
    if re.search(rf'(?m)^{key} = "', rest):
        new, count = re.subn(rf"(?m)^{key} = .*", f"{key} = {value}", rest, count=1)
    else:
        new, count = re.subn(
            rf"(?m)^{key} = \{{ value = (\[[^\]]*\]|[^,]+)", f"{key} = {{ value = {value}", rest, count=1
        )
    assert count == 1
    return head + mark + new


def without(key: str) -> str:
    text, count = re.subn(rf"(?m)^{key} = .*\n", "", RAVEN, count=1)
    assert count == 1
    return text


def reported_of_many(name: str) -> set[str]:
    """Keys of the values that the file tells of bodies and plates; what it leaves out is at rest, or nothing."""
    document: dict[str, Any] = tomllib.loads(load_vehicle(name).text)
    return {
        f"{family}.{member}.{key}"
        for family in REPEATED
        for member, table in document.get(family, {}).items()
        for key, entry in table.items()
        if not isinstance(entry, str)
    }


def test_the_folder_holds_the_known_vehicles() -> None:
    assert set(NAMES) <= set(vehicle_names())


@pytest.mark.parametrize("name", vehicle_names())
def test_every_value_of_every_vehicle_has_a_source(name: str) -> None:
    vehicle = load_vehicle(name)
    sections = {key: values for key, values in vehicle.sections.items() if key not in REPEATED}
    keys = {f"{section}.{key}" for section, values in sections.items() for key in values._fields}
    names = {"wing.right", "wing.left"}
    assert set(vehicle.sources) - reported_of_many(name) == keys - names
    assert reported_of_many(name) <= set(vehicle.sources)
    assert vehicle.name == name
    assert all(source.text for source in vehicle.sources.values())
    assert all(vehicle.sources[key].kind == "chosen" for key in vehicle.fitted)


def test_a_file_is_loaded_by_its_path(tmp_path: Path) -> None:
    vehicle = load_vehicle(written(tmp_path, changed("semispan", "0.5")))
    assert vehicle.wing.semispan == 0.5


@pytest.mark.parametrize(
    ("text", "reports"),
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
        (changed("strips", "inf"), r"wing\.strips must be a whole number \(4 to 60\), not inf"),
        (changed("frequencies", "1.0", "drive"), r"drive\.frequencies must be a list of numbers"),
        (changed("normal", "[0.0, 0.0, 0.0]", "plates.fin"), r"plates\.fin\.normal has no direction"),
        (changed("planform", '"delta"'), r'planform = "delta" must be "raven" or "ellipse"'),
        (changed("kind", '"rubber band"', "drive"), r'drive\.kind = "rubber band" must be'),
        (changed("frequencies", "[1.0]"), r"drive\.frequencies must have at least 2"),
        (changed("mass", "-0.04", "bodies.fuselage"), r"bodies\.fuselage\.mass = -0\.04 is outside 0 to 50 kg"),
        (
            changed("center", "[0.0, 0.0]", "bodies.right_wing"),
            r"bodies\.right_wing\.center must be a list of 3 numbers",
        ),
        (changed("area", "5.0", "plates.fin"), r"plates\.fin\.area = 5 is outside 0 to 2 m\^2"),
        (changed("body", '"nose"', "plates.fin"), r'plates\.fin\.body = "nose" is not one of the bodies: fuselage, '),
        (changed("left", '"third_wing"', "wing"), r'wing\.left = "third_wing" is not one of the bodies'),
        (RAVEN.replace('right = "right_wing"', "right = 1"), r"wing\.right must be text in quotes, not 1"),
        (changed("model", '"panels"', "aerodynamics"), r'unknown aerodynamic model "panels"; known: strip_theory, '),
        (changed("model", '"regression"', "aerodynamics"), r'model = "regression" needs a section \[regression\]'),
        (RAVEN.replace('value = 0.762, unit = "m"', 'value = 762, unit = "mm"'), r"wing\.semispan"),
        (RAVEN.replace("published: Gerdes Table 3, wing D; the", "rumour: the"), r"wing\.semispan"),
        (RAVEN.replace("[tail_servo]", "[tial_servo]"), "tial_servo"),
        ("not = [valid", "not valid TOML"),
        ("", "section .* is missing"),
    ],
)
def test_a_bad_file_is_refused_in_one_line_that_names_key_and_range(tmp_path: Path, text: str, reports: str) -> None:
    with pytest.raises(InputError, match=reports) as refused:
        load_vehicle(written(tmp_path, text))
    assert "\n" not in str(refused.value)


BASED = """base = "robo_raven_ii_d"
[wing]
semispan = { value = 0.5, unit = "m", source = "chosen: shorter" }
"""


def test_a_file_is_laid_over_its_base_key_by_key(tmp_path: Path) -> None:
    whole, bird = load_vehicle("robo_raven_ii_d"), load_vehicle(written(tmp_path, BASED))
    assert bird.wing == whole.wing._replace(semispan=0.5)
    assert {key for key in whole.sections if whole.sections[key] != bird.sections[key]} == {"wing"}
    assert {key for key in whole.sources if whole.sources[key] != bird.sources[key]} == {"wing.semispan"}
    assert bird.sources["wing.semispan"].text == "shorter" and bird.fitted == whole.fitted
    assert (bird.name, bird.title) == ("bird", "bird")


def test_a_value_replaces_its_bases_whole(tmp_path: Path) -> None:
    plain = 'stall_torque = { value = 2.0, unit = "N m", source = "chosen: weaker" }'
    bird = load_vehicle(written(tmp_path, f'base = "robo_raven_ii_d"\n[drive]\n{plain}'))
    assert bird.drive.stall_torque == 2.0 and "drive.stall_torque" not in bird.fitted
    assert "drive.no_load_speed" in bird.fitted


def test_what_is_kept_of_a_file_with_a_base_stands_alone(tmp_path: Path) -> None:
    for name in ("robo_raven_ii_a", written(tmp_path, BASED)):
        bird = load_vehicle(name)
        path = tmp_path / "apart" / f"{bird.name}.toml"
        path.parent.mkdir(exist_ok=True)
        path.write_text(bird.text, encoding="utf-8")
        assert "base" not in tomllib.loads(bird.text)
        assert load_vehicle(str(path))._replace(path=bird.path) == bird._replace(
            text=path.read_text(encoding="utf-8")
        )


@given(
    st.recursive(
        st.booleans()
        | st.integers(-(2**63), 2**63 - 1)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(),
        st.lists,
    )
)
def test_a_written_document_reads_as_it_was(value: Any) -> None:
    document = {"title": value, "a": {"key": {"value": value, "unit": "m"}, "plain": value}, "b": {"c": {"d": value}}}
    assert tomllib.loads(toml_text(document)) == document


def test_a_base_may_have_a_base_and_stand_beside_the_file(tmp_path: Path) -> None:
    written(tmp_path, BASED)
    path = tmp_path / "smaller.toml"
    path.write_text(
        'base = "bird.toml"\n[plates.fin]\narea = { value = 0.01, unit = "m^2", source = "chosen: less" }',
        encoding="utf-8",
    )
    smaller = load_vehicle(str(path))
    assert (smaller.wing.semispan, smaller.plates["fin"].area) == (0.5, 0.01)
    assert smaller.plates["fin"].lift_slope == 3.0


@pytest.mark.parametrize(
    ("base", "reports"),
    [
        ('"pterodactyl"', r'bird\.toml: base = "pterodactyl": unknown; known: .*robo_raven_ii_d'),
        ('"gone.toml"', r'base = "gone\.toml": no file .*gone\.toml'),
        ('"bird.toml"', r"bird\.toml: a circle of bases: bird -> bird$"),
        ('"other.toml"', r"bird\.toml: a circle of bases: bird -> other -> bird$"),
        ("7", r"bird\.toml: base must be a name or a file's path in quotes"),
    ],
)
def test_a_base_that_cannot_be_is_told_in_one_line(tmp_path: Path, base: str, reports: str) -> None:
    (tmp_path / "other.toml").write_text('base = "bird.toml"', encoding="utf-8")
    with pytest.raises(InputError, match=reports) as refused:
        load_vehicle(written(tmp_path, f"base = {base}"))
    assert "\n" not in str(refused.value)


def test_a_sensor_set_prevails_over_the_base_and_the_file_over_the_set(tmp_path: Path) -> None:
    gyroscope = '[gyroscope]\nnoise_deg_s = { value = 0.1, unit = "deg/s", source = "chosen: noisier" }'
    path = written(tmp_path, f'base = "robo_raven_ii_d"\nsensors = "modern"\n{gyroscope}')
    bird, raven, modern = load_vehicle(path), load_vehicle("robo_raven_ii_d"), load_vehicle("ulg_ornithopter")
    assert bird.sections["gyroscope"] == modern.sections["gyroscope"]._replace(noise_deg_s=0.1)
    for section in ("magnetometer", "encoder", "pitot", "barometer", "power_sensor", "gps"):
        assert bird.sections[section] == modern.sections[section] != raven.sections[section]
    assert (bird.wing, bird.sections["torque_cell"]) == (raven.wing, raven.sections["torque_cell"])
    assert "sensors" not in tomllib.loads(bird.text)
    (tmp_path / "alone.toml").write_text(bird.text, encoding="utf-8")
    assert load_vehicle(str(tmp_path / "alone.toml")).sections == bird.sections


def test_a_sensor_set_may_be_a_file_next_to_the_vehicle(tmp_path: Path) -> None:
    range_g = '[accelerometer]\nrange_g = { value = 32.0, unit = "g", source = "chosen: example" }'
    (tmp_path / "mine.toml").write_text(range_g, encoding="utf-8")
    bird = load_vehicle(written(tmp_path, 'base = "robo_raven_ii_d"\nsensors = "mine.toml"'))
    assert bird.sections["accelerometer"].range_g == 32.0


def test_an_unknown_sensor_set_is_reported_with_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r'sensors = "antique": unknown; known: gerdes_2017, modern$'):
        load_vehicle(written(tmp_path, 'base = "robo_raven_ii_d"\nsensors = "antique"'))


@pytest.mark.parametrize("name", flight_names())
def test_the_flight_computer_is_calibrated_for_the_sensors_of_the_vehicle(name: str) -> None:
    sections, gains = load_vehicle(name).sections, load_flight_vehicle(name).gains
    encoder, pitot, sensor = sections["encoder"], sections["pitot"], sections["power_sensor"]
    assert gains.wing_angle.counts_per_turn == encoder.counts_per_turn
    for side in ("left", "right"):
        index = getattr(encoder, f"index_{side}") * encoder.counts_per_turn / math.tau
        index += getattr(encoder, f"zero_{side}")
        assert getattr(gains.encoders, f"index_{side}") == math.floor(index)
    air = gains.air_data
    assert (air.differential_low, air.differential_high) == (pitot.counts_low, pitot.counts_high)
    assert (air.differential_range, air.pressure_noise) == (pitot.range, pitot.noise)
    assert air.static_scale == sections["barometer"].resolution
    assert gains.power.full_scale == 2**sensor.bits
    for key in ("reference", "divider", "current_zero", "current_sensitivity", "current_range"):
        assert getattr(gains.power, key) == pytest.approx(getattr(sensor, key), rel=1e-3)


def test_a_key_that_is_wrong_behind_a_base_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown key wing\.feathers"):
        load_vehicle(written(tmp_path, 'base = "robo_raven_ii_d"\n[wing]\nfeathers = { value = 9 }'))


@pytest.mark.parametrize("name", flight_names())
def test_the_flight_computer_believes_the_tails_travel_and_speed_that_are(name: str) -> None:
    believed, servo = load_flight_vehicle(name).gains.tail, load_vehicle(name).tail_servo
    assert (-believed.elevator_min, believed.elevator_max) == (servo.travel, servo.travel)
    assert believed.servo_rate == servo.rate_limit


def test_an_unknown_vehicle_is_told_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"unknown vehicle 'pterodactyl'; known: .*robo_raven_ii_d"):
        load_vehicle("pterodactyl")


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"gone\.toml"):
        load_vehicle(str(tmp_path / "gone.toml"))


@pytest.mark.parametrize(
    ("text", "reports"),
    [
        (
            changed("parent", '"tree"', "bodies.elevator"),
            r'bodies\.elevator\.parent = "tree" is not one of the bodies: fuselage, ',
        ),
        (changed("parent", '"elevator"', "bodies.elevator"), r'bodies\.elevator\.parent = "elevator" makes a loop'),
        (
            RAVEN.replace('parent = "fuselage"\nmoved_by = "rudder"', 'moved_by = "rudder"'),
            r'bodies\.rudder\.parent is missing: "fuselage" is the base already',
        ),
        (
            changed("moved_by", '"helm"', "bodies.rudder"),
            r'bodies\.rudder\.moved_by = "helm" must be one of right_wing',
        ),
        (changed("mirror_of", '"wing"', "bodies.left_wing"), r'bodies\.left_wing\.mirror_of = "wing" must be a body'),
        (changed("mass", "0.0", "bodies.rudder"), r"bodies\.rudder\.mass = 0 kg: a leaf without mass"),
        (
            changed("inertia", "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]", "bodies.rudder"),
            r"bodies\.rudder\.inertia: about the axis",
        ),
        (changed("right", '"fuselage"', "wing"), r'wing\.right = "fuselage" flaps about no joint'),
        (
            changed("right", '"elevator"', "wing"),
            r'wing\.right = "elevator" hangs on "elevator", which is of the tail',
        ),
        (
            changed("right", '"left_wing"', "wing").replace('\nleft = "left_wing"', '\nleft = "right_wing"'),
            r'wing\.right = "left_wing" hangs on "left_wing", which is of the left',
        ),
        (
            changed("parent", '"right_wing"', "bodies.left_wing"),
            r'wing\.left = "left_wing" hangs on "right_wing", which is of the right',
        ),
    ],
)
def test_bodies_that_make_no_vehicle_are_refused_in_one_line(tmp_path: Path, text: str, reports: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=reports) as refused:
        load_vehicle(path)
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_loop_through_mirror_images_is_refused_when_the_file_is_loaded(tmp_path: Path) -> None:
    text = changed("parent", '"left_wing"', "bodies.right_wing")
    text = text.replace('[bodies.left_wing]\nparent = "fuselage"', '[bodies.left_wing]\nparent = "right_wing"')
    with pytest.raises(InputError, match="makes a loop: right_wing on left_wing on right_wing") as refused:
        load_vehicle(written(tmp_path, text))
    assert "\n" not in str(refused.value)


def test_wings_on_one_joint_are_refused(tmp_path: Path) -> None:
    bird = load_vehicle("robo_raven_ii_d")
    plain = bird.bodies["right_wing"]._replace(moved_by="", axis=(0.0, 0.0, 0.0))
    bodies = bird.bodies | {
        "hinge": bird.bodies["right_wing"]._replace(moved_by=""),
        "right_wing": plain._replace(parent="hinge"),
        "left_wing": plain._replace(parent="hinge"),
    }
    with pytest.raises(
        InputError, match=r'wing\.left = "left_wing" hangs on the joint of "hinge", as the right wing'
    ):
        vehicle_bodies(bird._replace(bodies=bodies))


def test_a_bad_model_setting_is_refused_when_the_mechanism_is_built(tmp_path: Path) -> None:
    path = written(tmp_path, changed("dynamic_stall", '"never"', "strip_theory"))
    with pytest.raises(InputError, match=r'dynamic_stall = "never" is unknown; it is fixed or kim') as refused:
        build_mechanism(load_vehicle(path))
    assert "\n" not in str(refused.value) and path in str(refused.value)


def test_what_may_move_a_joint_is_what_the_mechanism_knows() -> None:
    assert {*MOVERS, ""} == set(CHANNELS)


def test_the_command_refuses_a_loop_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = RAVEN
    for name, parent in (("elevator", "rudder"), ("rudder", "elevator")):
        text = text.replace(f'parent = "fuselage"\nmoved_by = "{name}"', f'parent = "{parent}"\nmoved_by = "{name}"')
    path = written(tmp_path, text)
    assert main(["trim", path]) == 2
    reports = capsys.readouterr()
    assert reports.out == ""
    reason = 'bodies.elevator.parent = "rudder" makes a loop: elevator on rudder on elevator'
    assert reports.err == f"wingbeat: {path}: {reason}\n"


@pytest.mark.parametrize(("name", "grams"), [("robo_raven_ii_d", 359.0), ("arizona_100cm", 369.0)])
def test_the_bodies_weigh_what_the_papers_weighed(name: str, grams: float) -> None:
    """Gerdes Table 4, all-up weight with wing D; Malladi Table 1."""
    assert 1e3 * total_mass(load_vehicle(name)) == pytest.approx(grams, abs=0.1)


@pytest.mark.parametrize("name", NAMES)
def test_a_mirror_image_is_told_by_its_parent_alone(name: str) -> None:
    parts = all_parts(load_vehicle(name))
    left, right = parts["left_wing"], parts["right_wing"]
    assert (left.mass, left.stiffness, left.damping) == (right.mass, right.stiffness, right.damping)
    for x, y in zip(left.place[::2], right.place[::2], strict=True):
        assert x == y
    assert (left.place[1], left.center[1]) == (-right.place[1], -right.center[1])
    assert left.moved_by == "left_wing"
    # Wing up is a turn about x one way on the right, the other way on the left.
    assert left.axis == tuple(-part for part in right.axis)


@pytest.mark.parametrize("name", NAMES)
def test_a_vehicle_flies_with_any_model_that_its_file_has_a_section_of(name: str) -> None:
    bird = load_vehicle(name)
    for model in ("strip_theory", "quasi_steady", "blade_element"):
        other = with_model(bird, model)
        assert other.aerodynamics.model == model
        assert other._replace(aerodynamics=bird.aerodynamics) == bird
        assert build_mechanism(other).model.name == model


def test_another_model_is_refused_with_those_there_are() -> None:
    bird = load_vehicle("robo_raven_ii_d")
    with pytest.raises(InputError, match=r'^unknown aerodynamic model "panels"; known: strip_theory, quasi_steady'):
        with_model(bird, "panels")
    known = "strip_theory, quasi_steady, blade_element, vortex_lattice"
    has = rf"robo_raven_ii_d has no section \[regression\]; it has {known}$"
    with pytest.raises(InputError, match=has):
        with_model(bird, "regression")
