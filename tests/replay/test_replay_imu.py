"""Real recordings through the flight's attitude filter: goldens with tolerances, and what cannot be replayed."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from avionics.estimation.ahrs import RAZOR, AhrsGains
from avionics.vehicles.loader import load_vehicle, vehicle_names
from logs.replay import imu
from wingbeat.errors import InputError

ROOT = Path(__file__).parents[2]
TRIAL = ROOT / "tests" / "data" / "broad" / "trial_16_fast_translation_25_to_75_s.npz"
SHARED = Path(os.environ.get("WINGBEAT_SHARED", ROOT.parent / "shared")) / "data" / "imu"

needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(),
    reason="the four BROAD trials are not here: set WINGBEAT_SHARED or put a folder `shared` beside the repository",
)


def quaternions(count: int, seed: int = 1) -> imu.Array:
    q = np.random.default_rng(seed).standard_normal((count, 4))
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def trial(**changes: Any) -> dict[str, Any]:
    """Arrays of a recording at rest, level, body x to the north, two seconds long."""
    count = 200
    arrays: dict[str, Any] = {
        "gyr": np.zeros((count, 3)),
        "acc": np.tile([0.0, 0.0, -9.81], (count, 1)),
        "mag": np.tile([20.0, 0.0, 42.0], (count, 1)),
        "quat": np.tile(imu.ENU_FROM_NED, (count, 1)),
        "movement": np.ones(count),
        "rate": 100.0,
    }
    return {key: value for key, value in (arrays | changes).items() if value is not None}


def saved(path: Path, **changes: Any) -> Path:
    np.savez(path, **trial(**changes))
    return path


def test_trial_of_the_repository() -> None:
    """Golden: the part of trial 16 (a hand shaking at several g), with the gains that every vehicle flies."""
    (score,) = imu.replay_imu([TRIAL])
    assert score.file == TRIAL.name
    assert score.total_deg == pytest.approx(0.97, abs=0.15)
    assert score.heading_deg == pytest.approx(0.75, abs=0.15)
    assert score.inclination_deg == pytest.approx(0.62, abs=0.1)


def test_golden_depends_on_the_filter() -> None:
    """GIVEN gains that trust each short mean THEN the shaking shows: the golden can fail."""
    hasty = AhrsGains(fixed_block=0.1, tilt_time=0.5, tilt_limit=3.0, gravity_tolerance=1.0)
    (score,) = imu.replay_imu([TRIAL], hasty)
    assert score.inclination_deg > 1.5


@needs_shared
def test_shared_trials_with_one_parameter_set() -> None:
    scores = {score.file[6:8]: score for score in imu.replay_imu([SHARED])}
    mean = imu.means(list(scores.values()))
    assert len(scores) == 4
    assert mean.total_deg <= 2.29
    assert mean.inclination_deg <= 1.05
    assert scores["16"].total_deg <= 3.5
    assert scores["30"].total_deg <= 4.5


def test_averages_beat_the_classic_corrections() -> None:
    """GIVEN a hand that shakes the sensor WHEN the Razor takes each sample for gravity THEN it fails."""
    (ours,), (classic,) = imu.replay_imu([TRIAL]), imu.replay_imu([TRIAL], AhrsGains(method=RAZOR))
    assert classic.inclination_deg > 20.0
    assert ours.inclination_deg < 0.05 * classic.inclination_deg
    assert ours.total_deg < 0.05 * classic.total_deg


@needs_shared
def test_classic_corrections_err_as_those_measured_elsewhere() -> None:
    """The shared README tells 96 and 58 degrees of a Razor DCM with its default gains; here 97.7 and 60.2."""
    scores = {score.file[6:8]: score for score in imu.replay_imu([SHARED], AhrsGains(method=RAZOR))}
    assert scores["16"].total_deg == pytest.approx(96.0, rel=0.1)
    assert scores["30"].total_deg == pytest.approx(58.0, rel=0.1)
    assert scores["08"].total_deg < 10.0


@pytest.mark.parametrize("method", list(imu.METHODS.values()))
def test_recording_at_rest_scores_nothing_by_either_method(tmp_path: Path, method: int) -> None:
    (score,) = imu.replay_imu([saved(tmp_path / "still.npz")], AhrsGains(method=method))
    assert score[1:] == pytest.approx((0.0, 0.0, 0.0), abs=1e-5)


def test_heading_of_the_reference_is_from_east_to_north(tmp_path: Path) -> None:
    """GIVEN a sensor that heads east and a reference that says north THEN heading is 90 degrees off, tilt none."""
    (score,) = imu.replay_imu([saved(tmp_path / "east.npz", mag=np.tile([0.0, -20.0, 42.0], (200, 1)))])
    assert score.heading_deg == pytest.approx(90.0, abs=1e-4)
    assert score.inclination_deg == pytest.approx(0.0, abs=1e-4)


def test_errors_of_a_known_rotation() -> None:
    reference = quaternions(50)
    for axis, expected in ((3, (0.4, 0.4, 0.0)), (1, (0.4, 0.0, 0.4))):
        turn = np.zeros((1, 4))
        turn[0, 0], turn[0, axis] = np.cos(0.2), np.sin(0.2)
        errors = imu.orientation_errors(imu.multiply(turn, reference), reference)
        for error, value in zip(errors, expected, strict=True):
            assert error == pytest.approx(np.full(50, value), abs=1e-6)


def test_errors_do_not_see_the_sign_of_a_quaternion() -> None:
    a, b = quaternions(50, 1), quaternions(50, 2)
    for plain, flipped in zip(imu.orientation_errors(a, b), imu.orientation_errors(-a, b), strict=True):
        assert plain == pytest.approx(flipped)


def test_folder_stands_for_its_recordings_by_name(tmp_path: Path) -> None:
    for name in ("b.npz", "a.npz"):
        saved(tmp_path / name)
    (tmp_path / "notes.txt").write_text("no recording")
    seen: list[imu.ImuScore] = []
    scores = imu.replay_imu([tmp_path, tmp_path / "b.npz"], scored=seen.append)
    assert [score.file for score in scores] == ["a.npz", "b.npz", "b.npz"]
    assert seen == scores
    row = json.loads(json.dumps(imu.rows(scores)))[0]
    assert list(row) == ["file", "total_deg", "heading_deg", "inclination_deg"]


def test_short_gaps_are_bridged(tmp_path: Path) -> None:
    acc = trial()["acc"]
    acc[50:60] = np.nan
    (score,) = imu.replay_imu([saved(tmp_path / "gap.npz", acc=acc)])
    assert score.total_deg == pytest.approx(0.0, abs=1e-4)


def with_nan(first: int, last: int) -> imu.Array:
    gyr = np.zeros((200, 3))
    gyr[first:last, 1] = np.nan
    return gyr


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mag": None, "quat": None}, "no mag, quat in it"),
        ({"gyr": np.zeros((0, 3))}, "no samples"),
        ({"gyr": np.float64(3.0)}, "no samples"),
        ({"acc": np.zeros((200, 2))}, "acc has shape"),
        ({"quat": np.zeros((199, 4))}, "quat has shape"),
        ({"movement": np.ones((200, 1))}, "movement has shape"),
        ({"rate": 0.0}, "rate must be"),
        ({"rate": np.nan}, "rate must be"),
        ({"rate": np.array([100.0, 100.0])}, "rate must be"),
        ({"rate": np.array("fast")}, "not a readable .npz recording"),
        ({"gyr": with_nan(0, 1)}, "first sensor sample"),
        ({"gyr": with_nan(20, 120)}, "not finite for 1.00 s from 0.20 s"),
        ({"gyr": with_nan(100, 200)}, "not finite for 1.00 s from 1.00 s"),
        ({"movement": np.zeros(200)}, "no sample has movement"),
        ({"quat": np.full((200, 4), np.nan)}, "no sample has movement"),
        ({"quat": np.array([None] * 200, dtype=object)}, "not a readable .npz recording"),
    ],
)
def test_recording_that_cannot_be_scored_says_why(tmp_path: Path, changes: dict[str, Any], words: str) -> None:
    path = saved(tmp_path / "bad.npz", **changes)
    with pytest.raises(InputError, match=words) as caught:
        imu.replay_imu([path])
    text = str(caught.value)
    assert text.startswith(str(path))
    assert "\n" not in text


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 torn", b"\x93NUMPY\x01\x00"])
def test_file_that_is_no_archive(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"bad\.npz: ") as caught:
        imu.replay_imu([path])
    assert "\n" not in str(caught.value)


def test_archive_cut_off_or_damaged(tmp_path: Path) -> None:
    whole = TRIAL.read_bytes()
    cut = tmp_path / "cut.npz"
    cut.write_bytes(whole[: len(whole) // 2])
    damaged = tmp_path / "damaged.npz"
    damaged.write_bytes(whole[:5000] + bytes(200) + whole[5200:])
    for path in (cut, damaged):
        with pytest.raises(InputError, match="not a readable"):
            imu.replay_imu([path])


def test_array_of_another_kind(tmp_path: Path) -> None:
    single = tmp_path / "single.npz"
    with single.open("wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(InputError, match="one array"):
        imu.replay_imu([single])
    foreign = tmp_path / "foreign.npz"
    with zipfile.ZipFile(foreign, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(InputError, match="no gyr"):
        imu.replay_imu([foreign])


def test_paths_without_recordings(tmp_path: Path) -> None:
    for paths, words in (([], "no IMU recording"), ([tmp_path / "x.npz"], "no such"), ([tmp_path], "no .npz")):
        with pytest.raises(InputError, match=words):
            imu.replay_imu(paths)


@pytest.mark.parametrize("name", vehicle_names())
def test_every_vehicle_flies_the_gains_that_are_scored_here(name: str) -> None:
    """One parameter set: a vehicle has the magnetic field of its place, nothing else of its own."""
    flown = load_vehicle(name).gains.ahrs
    assert flown._replace(declination=0.0, field_strength=0.0, field_dip=0.0) == AhrsGains()
