"""Vehicle files and the parameters made of them."""

import math
import struct
import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from avionics import parameters
from avionics.vehicles import load_vehicle, vehicle_names
from avionics.vehicles.loader import SECTIONS
from wingbeat.documents import toml_text
from wingbeat.errors import InputError

VEHICLES = {name: load_vehicle(name) for name in vehicle_names()}
RAVEN = VEHICLES["robo_raven_ii_d"]
TABLE = parameters.parameter_table(RAVEN.gains)


def test_both_vehicles_come_along() -> None:
    assert {"robo_raven_ii_d", "arizona_100cm"} <= set(VEHICLES)
    assert VEHICLES["arizona_100cm"].gains.flapping.drive == "motor"
    assert VEHICLES["arizona_100cm"].gains.altitude.throttle_trim == 0.35


@pytest.mark.parametrize("name", vehicle_names())
def test_every_number_has_a_source_or_is_a_default(name: str) -> None:
    vehicle = VEHICLES[name]
    for section, gains in vehicle.gains._asdict().items():
        for key, value in gains._asdict().items():
            if f"{section}.{key}" in vehicle.defaults:
                assert value == gains._field_defaults[key]
            elif key != "law":
                assert f"{section}.{key}" in vehicle.file.sources


def test_vehicle_files_list_only_what_differs_or_belongs_to_the_vehicle() -> None:
    """No value of an estimator or a detector is repeated in every file with the same reason."""
    texts = [vehicle.file.sources for vehicle in VEHICLES.values()]
    for key in set.intersection(*map(set, texts)):
        if key.partition(".")[0] in SECTIONS:
            assert not all("default of the" in each[key].text for each in texts), key


@pytest.mark.parametrize("section", SECTIONS)
def test_a_missing_key_takes_the_default_of_its_gains(section: str, tmp_path: Path) -> None:
    """GIVEN a file without the keys of a section that have a default WHEN it is read THEN they have it."""
    record = SECTIONS[section]
    document = tomllib.loads(RAVEN.file.text)
    kept = {key: entry for key, entry in document.pop(section, {}).items() if key not in record._field_defaults}
    path = tmp_path / "mine.toml"
    path.write_text(toml_text(document | ({section: kept} if kept else {})), encoding="utf-8")
    vehicle = load_vehicle(path)
    gains = getattr(vehicle.gains, section)
    assert {key: getattr(gains, key) for key in record._field_defaults} == record._field_defaults
    assert {f"{section}.{key}" for key in record._field_defaults if key != "law"} <= set(vehicle.defaults)
    assert vehicle.gains._replace(**{section: None}) == RAVEN.gains._replace(**{section: None})


def test_a_new_gain_needs_a_default() -> None:
    """The keys that a user's file must have: one more would refuse files that were good."""
    required = {
        f"{section}.{key}"
        for section, record in SECTIONS.items()
        for key in record._fields
        if key not in record._field_defaults
    }
    earlier = (Path(__file__).parents[1] / "data" / "required_keys.txt").read_text(encoding="utf-8").split()
    assert required <= set(earlier)


@pytest.mark.parametrize("name", vehicle_names())
def test_names_are_unique_short_and_plain(name: str) -> None:
    table = parameters.parameter_table(VEHICLES[name].gains)
    assert len(table) > 150
    for word, entry in table.items():
        assert word == entry.name
        assert len(word) <= 16
        assert word.isascii()
        assert word.upper() == word
        assert entry.low <= parameters.get(VEHICLES[name].gains, entry) <= entry.high
        assert entry.unit


def test_names_that_were_flown_stay() -> None:
    flown = {
        "PITCH_P",
        "PITCH_I",
        "PITCH_D",
        "ROLL_P",
        "HDG_P",
        "ALT_P",
        "ALT_THR_TRIM",
        "NAV_APP_LENGTH",
        "FLAP_FREQ_PT_1",
    }
    assert flown <= set(TABLE)


@given(name=st.sampled_from(sorted(TABLE)), share=st.floats(0, 1))
def test_a_value_set_over_the_wire_reads_back_the_same_single(name: str, share: float) -> None:
    entry = TABLE[name]
    value = parameters.single(entry.low + share * (entry.high - entry.low))
    value = float(round(value)) if entry.whole else value
    change = parameters.set_value(RAVEN.gains, TABLE, name, value)
    if not change.accepted:
        assert name.startswith("FLAP_THR_PT")
        return
    fixed = parameters.get(change.gains, entry)
    assert struct.pack("<f", fixed) == struct.pack("<f", value)
    assert fixed == change.value
    others = [
        n for n, e in TABLE.items() if n != name and parameters.get(change.gains, e) != parameters.get(RAVEN.gains, e)
    ]
    assert others == []


@pytest.mark.parametrize(("value", "fixed"), [(99.0, 10.0), (-1.0, 0.0), (math.inf, 10.0), (-math.inf, 0.0)])
def test_a_value_out_of_range_is_clipped_and_said(value: float, fixed: float) -> None:
    change = parameters.set_value(RAVEN.gains, TABLE, "PITCH_P", value)
    assert (change.gains.pitch.proportional, change.accepted) == (fixed, True)
    assert "out of range" in change.text


@pytest.mark.parametrize(
    ("name", "value", "word"), [("PITCH_P", math.nan, "not a number"), ("PITCH_X", 1.0, "unknown")]
)
def test_what_cannot_be_set_changes_nothing(name: str, value: float, word: str) -> None:
    change = parameters.set_value(RAVEN.gains, TABLE, name, value)
    assert change.gains is RAVEN.gains
    assert not change.accepted
    assert word in change.text


def test_a_frequency_map_that_does_not_rise_is_refused() -> None:
    change = parameters.set_value(RAVEN.gains, TABLE, "FLAP_THR_PT_2", 0.0)
    assert not change.accepted
    assert "rise" in change.text


def edited(tmp_path: Path, old: str, new: str) -> Path:
    text = RAVEN.file.text
    assert old in text
    path = tmp_path / "vehicle.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new", "reports"),
    [
        ("[pitch]\nproportional = { value = ", "[pitch]\nproportional = { value = 50", ["pitch.proportional", "10"]),
        ('drive = { value = "servo"', 'drive = { value = "steam"', ["flapping.drive", "steam"]),
        ("[roll]", "[rolling]", ["unknown section [rolling]", "roll"]),
        ("[roll]\n", '[roll]\nspin = { value = 1, unit = "-", source = "chosen: x" }\n', ["unknown key roll.spin"]),
    ],
)  # fmt: skip
def test_a_bad_vehicle_file_is_refused_in_one_line(tmp_path: Path, old: str, new: str, reports: list[str]) -> None:
    with pytest.raises(InputError) as refusal:
        load_vehicle(edited(tmp_path, old, new))
    assert "\n" not in str(refusal.value)
    for words in reports:
        assert words in str(refusal.value)


def test_an_unknown_vehicle_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"arizona_100cm, robo_raven_ii_d"):
        load_vehicle("condor")


def test_a_vehicle_is_found_by_its_path(tmp_path: Path) -> None:
    path = edited(tmp_path, 'name = "robo_raven_ii_d"', 'name = "mine"')
    assert load_vehicle(path).name == "mine"


PINNED = Path(__file__).parents[1] / "data" / "parameter_names.txt"


def test_mavlink_parameter_names_stay() -> None:
    """GIVEN the names of both vehicles as released THEN all are still there: saved parameter files hold them."""
    names = {name for vehicle in VEHICLES.values() for name in parameters.parameter_table(vehicle.gains)}
    assert set(PINNED.read_text().split()) <= names


def test_vehicle_file_with_an_earlier_key_is_read(tmp_path: Path) -> None:
    """GIVEN a vehicle file with a key's earlier name WHEN it is read THEN its value counts, over its base too."""
    text = RAVEN.file.text
    old = text.replace(
        "[wing_check]\n", '[wing_check]\nstill_time = { value = 0.31, unit = "s", source = "chosen: old" }\n'
    )
    assert old != text
    (tmp_path / "copied.toml").write_text(old)
    assert load_vehicle(tmp_path / "copied.toml").gains.wing_check.jam_confirmation_time == 0.31
    derived = tmp_path / "derived.toml"
    derived.write_text(
        'base = "robo_raven_ii_d"\n[wing_check]\n'
        'still_time = { value = 0.77, unit = "s", source = "chosen: for this test" }\n'
    )
    gains = load_vehicle(derived).gains
    assert gains.wing_check.jam_confirmation_time == 0.77
    assert parameters.get(gains, parameters.parameter_table(gains)["CHKW_STILL_TIME"]) == 0.77
