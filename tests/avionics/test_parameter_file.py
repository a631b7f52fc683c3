"""Parameters over restarts: what is kept, what is believed, what is moved aside."""

import hashlib
import json
from pathlib import Path

import pytest

from avionics import parameters
from avionics.board.parameter_file import FORMAT, AnotherVehicles, ParameterFile, default_path, key_path, unused_files
from avionics.gains import FlightGains
from avionics.vehicles import FlightVehicle, load_vehicle
from wingbeat.errors import InputError

RAVEN = load_vehicle("robo_raven_ii_d")


def changed(**values: float) -> FlightGains:
    gains, table = RAVEN.gains, parameters.parameter_table(RAVEN.gains)
    for name, value in values.items():
        gains = parameters.set_value(gains, table, name, value).gains
    return gains


def file(tmp_path: Path, vehicle: FlightVehicle = RAVEN) -> ParameterFile:
    return ParameterFile(tmp_path / "state" / "raven.json", vehicle)


def test_without_a_file_the_vehicles_own_values_hold_and_nothing_is_said(tmp_path: Path) -> None:
    loaded = file(tmp_path).load()
    assert (loaded.vehicle, loaded.text, loaded.damaged) == (RAVEN, "", False)
    assert not (tmp_path / "state").exists()


def test_changed_parameters_come_back_exactly_and_only_they_are_written(tmp_path: Path) -> None:
    gains = changed(PITCH_P=0.7, IMU_ACCEL_OFS_2=-0.123, NAV_ACCEPTANCE=7.3)
    first = file(tmp_path)
    first.load()
    assert first.keep(gains, armed=False)
    document = json.loads(first.path.read_text())
    assert set(document["values"]) == {"PITCH_P", "IMU_ACCEL_OFS_2", "NAV_ACCEPTANCE"}
    loaded = file(tmp_path).load()
    assert loaded.vehicle.gains == gains
    assert "3 parameters from" in loaded.text
    assert [path.name for path in first.path.parent.iterdir()] == ["raven.json"]


def test_nothing_is_written_while_armed_or_without_a_change(tmp_path: Path) -> None:
    kept = file(tmp_path)
    kept.load()
    gains = changed(PITCH_P=0.7)
    assert not kept.keep(RAVEN.gains, armed=False)
    assert not kept.keep(gains, armed=True)
    assert not kept.path.exists()
    assert kept.keep(gains, armed=False)
    assert not kept.keep(gains, armed=False)


@pytest.mark.parametrize(
    ("spoil", "reports"),
    [
        (lambda text: text.replace("0.7", "0.8"), "checksum"),
        (lambda text: text[: len(text) // 2], "is not a parameter file"),
        (lambda text: "[1, 2]", "is not a parameter file"),
        (lambda text: "", "is not a parameter file"),
        (lambda text: text.replace("parameters 1", "parameters 9"), "another format"),
        (lambda text: "\ufeff" + text, "is not a parameter file"),
    ],
)
def test_a_damaged_file_falls_back_and_is_kept_beside(tmp_path: Path, spoil, reports: str) -> None:
    kept = file(tmp_path)
    kept.save({"PITCH_P": 0.7})
    spoiled = spoil(kept.path.read_text())
    for number, name in enumerate(("raven.json.damaged", "raven.json.damaged-2")):
        kept.path.write_text(spoiled)
        loaded = file(tmp_path).load()
        assert loaded.damaged
        assert loaded.vehicle == RAVEN
        assert reports in loaded.text and name in loaded.text and "\n" not in loaded.text, number
        assert (kept.path.parent / name).read_text() == spoiled
        assert not kept.path.exists()


def test_another_vehicles_file_is_refused_and_left_alone(tmp_path: Path) -> None:
    file(tmp_path).save({"PITCH_P": 0.7})
    other = file(tmp_path, load_vehicle("arizona_100cm"))
    before = other.path.read_bytes()
    for look in (other.load, other.check_owner):
        with pytest.raises(AnotherVehicles, match="belongs to vehicle robo_raven_ii_d and is not changed"):
            look()
    assert [path.name for path in other.path.parent.iterdir()] == ["raven.json"]
    assert other.path.read_bytes() == before


def test_who_asks_for_the_owner_leaves_a_damaged_file_to_the_one_who_loads(tmp_path: Path) -> None:
    kept = file(tmp_path)
    kept.check_owner()
    kept.save({"PITCH_P": 0.7})
    kept.check_owner()
    kept.path.write_text("spoiled")
    kept.check_owner()
    assert kept.path.read_text() == "spoiled"


def test_a_name_that_is_gone_or_a_value_out_of_range_is_passed_over_and_said(tmp_path: Path) -> None:
    kept = file(tmp_path)
    defaults = kept.defaults()
    kept.defaults = lambda: {**defaults, "OLD_GAIN": 0.0}  # type: ignore[method-assign]
    kept.save({"OLD_GAIN": 3.0, "PITCH_P": 0.75, "ROLL_P": 1e9})
    loaded = file(tmp_path).load()
    assert loaded.vehicle.gains.pitch.proportional == 0.75
    assert loaded.vehicle.gains.roll == RAVEN.gains.roll
    assert loaded.text.endswith("ignored: OLD_GAIN, ROLL_P")


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept = file(tmp_path)
    kept.save({"PITCH_P": 0.75})
    before = kept.path.read_bytes()

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="No space"):
        kept.save({"PITCH_P": 0.9})
    assert kept.path.read_bytes() == before
    assert [path.name for path in kept.path.parent.iterdir()] == ["raven.json"]


def test_a_folder_in_the_files_place_is_bad_input(tmp_path: Path) -> None:
    kept = file(tmp_path)
    kept.path.mkdir(parents=True)
    with pytest.raises(InputError, match="is not a file"):
        kept.load()


def test_the_file_of_a_vehicle_is_in_the_users_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WINGBEAT_STATE", str(tmp_path))
    raven = load_vehicle("robo_raven_ii_d")
    assert default_path(raven) == tmp_path / "parameters" / "robo_raven_ii_d.json"
    monkeypatch.delenv("WINGBEAT_STATE")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "xdg"))
    monkeypatch.setattr("sys.platform", "linux")
    assert default_path(raven) == tmp_path / "xdg" / "wingbeat" / "parameters" / "robo_raven_ii_d.json"


def copied(folder: Path, name: str = "robo_raven_ii_d") -> FlightVehicle:
    """A user's copy of the Robo Raven in a folder, with that name in its file."""
    folder.mkdir(parents=True)
    text = load_vehicle("robo_raven_ii_d").file.text
    (folder / "avionics.toml").write_text(text.replace('name = "robo_raven_ii_d"', f'name = "{name}"', 1))
    return load_vehicle(folder / "avionics.toml")


def test_copied_vehicles_store_by_their_folders(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """GIVEN copies whose name was left unchanged THEN neither parameters nor keys mix."""
    monkeypatch.setenv("WINGBEAT_STATE", str(tmp_path / "state"))
    vehicles = [
        load_vehicle("robo_raven_ii_d"),
        copied(tmp_path / "my bird"),
        copied(tmp_path / "other"),
        copied(tmp_path / "birds" / "robo_raven_ii_d"),
    ]
    names = ["robo_raven_ii_d", "my_bird", "other", "robo_raven_ii_d-custom"]
    assert [default_path(vehicle).stem for vehicle in vehicles] == names
    assert [key_path(vehicle).stem for vehicle in vehicles] == names
    ParameterFile(default_path(vehicles[1]), vehicles[1]).save({"PITCH_P": 0.9})
    earlier = tmp_path / "state" / "signing" / "robo_raven_ii_d.key"
    earlier.parent.mkdir()
    earlier.touch()
    assert unused_files(vehicles[0]) == []
    assert unused_files(vehicles[1]) == [
        f"{earlier} is not used for this vehicle; to use it, copy it to {earlier.with_stem('my_bird')}"
    ]
    with pytest.raises(AnotherVehicles):
        ParameterFile(default_path(vehicles[1]), vehicles[0]).stored()
    with pytest.raises(AnotherVehicles):
        ParameterFile(default_path(vehicles[1]), vehicles[2]).stored()
    assert ParameterFile(default_path(vehicles[1]), vehicles[1]).stored() == {"PITCH_P": 0.9}


def test_parameters_stored_by_the_name_in_the_file_are_found(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("WINGBEAT_STATE", str(tmp_path / "state"))
    vehicle = copied(tmp_path / "folder", "thunderbird")
    earlier = tmp_path / "state" / "parameters" / "thunderbird.json"
    document = {"format": FORMAT, "vehicle": "thunderbird", "values": {"PITCH_P": 0.9}}
    earlier.parent.mkdir(parents=True)
    canonical = json.dumps(document, sort_keys=True, separators=(",", ":"))
    earlier.write_text(json.dumps({**document, "sha256": hashlib.sha256(canonical.encode()).hexdigest()}))
    assert default_path(vehicle) == earlier
    assert ParameterFile(default_path(vehicle), vehicle).stored() == {"PITCH_P": 0.9}
