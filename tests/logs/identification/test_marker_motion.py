"""`wingbeat identify CAPTURE markers`: a flight capture of the Slow Hawk from files to motion and coefficients."""

from __future__ import annotations

import json
import tomllib
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from groundstation.command import identify
from groundstation.command.main import main
from logs.identification.motion_capture.coordinates import kinematic_chain
from logs.identification.motion_capture.markers import find_swap
from logs.identification.motion_capture.motion import POSITION_ERROR, Speeds
from logs.identification.sources.table.config import example_map
from logs.identification.sources.table.markers import (
    clouds_of_tables,
    identify_markers,
    load_markers_map,
)
from tests.logs.identification import slow_hawk_flight as hawk
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import dcms_from_quaternions

NOISE = 0.0013
FRAMES = 600
EXAMPLE = example_map("markers")
PLACES: dict[str, dict[str, list[float]]] = tomllib.loads(EXAMPLE)["markers"]["places"]
NAMES = [name for markers in PLACES.values() for name in markers]
SECTION = EXAMPLE.partition("# Of a table")[0]
UP = (1.0, -1.0, -1.0)
"""forward, left and up, as a laboratory counts, from north, east and down"""
Capture = dict[str, NDArray[np.float64]]


def capture(frames: int = FRAMES) -> Capture:
    """Positions (N, 3) in mm by marker; one wing tip is lost for 30 frames."""
    flight = hawk.fly(3.0, 1).cut(0, frames)
    observed = hawk.observed(flight, NOISE, 6)
    tracks = {
        name: 1e3 * observed[body][place] * UP
        for body, markers in PLACES.items()
        for place, name in enumerate(markers)
    }
    tracks["tip_right"][100:130] = np.nan
    return tracks


def cells(tracks: Capture, frame: int) -> str:
    return ",".join(f"{v:.4f}" if np.isfinite(v) else "" for name in NAMES for v in tracks[name][frame])


def table(folder: Path, tracks: Capture) -> Path:
    """A plain table and its map."""
    head = "t," + ",".join(f"{name} {axis}" for name in NAMES for axis in "XYZ")
    rows = [f"{hawk.STEP * n:.4f},{cells(tracks, n)}" for n in range(len(tracks["nose"]))]
    (folder / "take.csv").write_text("\n".join([head, *rows]) + "\n")
    signals = [f'{n}_{a.lower()} = {{ column = "{n} {a}", unit = "mm" }}' for n in NAMES for a in "XYZ"]
    axes = "axes = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]"
    (folder / "take.toml").write_text(
        "\n".join(
            ['[time]\ncolumn = "t"\n[signals]', *signals, SECTION.replace("[markers]", f"[markers]\n{axes}", 1)]
        )
    )
    return folder / "take.csv"


def nexus(folder: Path, tracks: Capture) -> Path:
    """The same as Vicon Nexus exports it, imported as a log."""
    lines = ["Trajectories", "500", ",," + ",".join(f"{name},," for name in NAMES)]
    lines += ["Frame,Sub Frame," + ",".join("X,Y,Z" for _ in NAMES), ",," + ",".join("mm,mm,mm" for _ in NAMES)]
    lines += [f"{n + 1},0,{cells(tracks, n)}" for n in range(len(tracks["nose"]))]
    (folder / "nexus.csv").write_text("\n".join(lines) + "\n")
    assert main(["log", "import", str(folder / "nexus.csv"), "--to", str(folder / "capture.mcap")]) == 0
    (folder / "places.toml").write_text(SECTION)
    return folder / "capture.mcap"


def test_coordinates_of_a_table_are_those_flown_within_their_errors(tmp_path: Path) -> None:
    path = table(tmp_path, capture())
    mapped = load_markers_map(path.with_suffix(".toml"))
    clouds, _ = clouds_of_tables([path], mapped)
    (motion,) = identify_markers(hawk.vehicle(), mapped.markers, clouds).motions
    assert motion.noise.contains(NOISE) and motion.noise.value == pytest.approx(NOISE, rel=0.05)
    flight = hawk.fly(3.0, 1).cut(0, FRAMES)
    expected = (motion.coordinates.angles - flight.states[:, 13:17]) / motion.errors[:, 6:]
    assert motion.known.all()
    assert np.std(expected, axis=0) == pytest.approx(1.0, abs=0.15)
    lost = motion.errors[100:130, 6].mean()
    # The rest of the wing's markers tell its angle half as well, beside the fuselage's roll, the larger of the two.
    assert lost > 1.1 * motion.errors[130:, 6].mean()
    (speeds,) = motion.speeds
    # What noise makes of a speed at 50 Hz grows with the cut-off to the power 1.5.
    assert np.std((speeds.speeds - hawk.moved(flight).speeds)[30:-30, 2]) < 0.1


def off(speeds: Speeds, body: str) -> tuple[float, float]:
    """Root mean square errors in m and rad per axis of a body by the smoothed coordinates, ends left out."""
    index, inside = hawk.marked()[body][0], slice(30, -30)
    chain, base = kinematic_chain(hawk.mechanism().tree, speeds.angles), dcms_from_quaternions(speeds.quaternion)
    position, rotation = hawk.true_poses(hawk.fly(3.0, 1).cut(0, FRAMES), body)
    away = speeds.position_ned + np.einsum("nij,nj->ni", base, chain.position[index]) - position
    turn = np.einsum("nji,njk->nik", rotation, base @ chain.rotation[index])
    turns = 0.5 * np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1)
    at, about = (float(np.sqrt(np.mean(np.square(values[inside])))) for values in (away, turns))
    return at, about


def test_bodies_are_found_as_well_as_the_paper_found_them(tmp_path: Path) -> None:
    path = table(tmp_path, capture())
    mapped = load_markers_map(path.with_suffix(".toml"))
    (motion,) = identify_markers(hawk.vehicle(), mapped.markers, clouds_of_tables([path], mapped)[0]).motions
    found = {body: off(motion.speeds[0], body) for body in hawk.MARKERS}
    assert max(at for at, _ in found.values()) < 0.001
    assert max(about for _, about in found.values()) < 0.0045


def test_an_imported_capture_gives_motion_and_coefficients(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = nexus(tmp_path, capture(500))
    capsys.readouterr()
    words = [str(path), "markers", "--map", str(tmp_path / "places.toml"), "--report", str(tmp_path / "r.html")]
    assert identify.run([*words, "--json"]) == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    (record,) = found["markers"]["records"]
    assert record["frames"] == record["told"] == 500 and found["markers"]["vehicle"] == "slow_hawk"
    tracks = {one["name"]: one for one in record["coordinates"]}
    flight = hawk.fly(3.0, 1).cut(0, 500)
    down = np.array(tracks["down"]["values"]) - flight.states[:, 2]
    assert np.std(down) < 0.001
    assert np.median(tracks["left_wing"]["standard_errors"]) < 0.01
    assert len(record["speeds"][0]["values"]) == 500
    expected = {one["name"]: one for model in found["aero"]["models"] for one in model["estimates"]}
    assert expected["C_m_omega_y"]["value"] == pytest.approx(hawk.TRUTH["C_m"]["omega_y"], rel=0.1)
    assert expected["C_L_theta_11_rate"]["value"] == pytest.approx(hawk.TRUTH["C_L"]["theta_11_rate"], rel=0.1)
    page = (tmp_path / "r.html").read_text()
    assert "Motion by markers" in page and "capture.mcap" in page and "Wing coefficients" in page


def test_a_rigid_body_needs_no_vehicle(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path, capture())
    whole, _, _ = path.with_suffix(".toml").read_text().partition("[markers]")
    at = "".join(f"{name} = {place}\n" for name, place in PLACES["rudder"].items())
    axes = "axes = [[1, 0, 0], [0, -1, 0], [0, 0, -1]]"
    path.with_suffix(".toml").write_text(f"{whole}[markers]\n{axes}\n[markers.places.rudder]\n{at}")
    words = [str(path), "markers", "--map", str(path.with_suffix(".toml"))]
    assert identify.run([*words, "--json", "--report", str(tmp_path / "r.html")]) == 0
    (record,) = json.loads(capsys.readouterr().out)["markers"]["records"]
    position, rotation = hawk.true_poses(hawk.fly(3.0, 1).cut(0, FRAMES), "rudder")
    names = [one["name"] for one in record["coordinates"]]
    assert names == ["north", "east", "down", "roll", "pitch", "yaw"]
    away = np.transpose([one["values"] for one in record["coordinates"][:3]]) - position
    error = np.transpose([one["standard_errors"] for one in record["coordinates"][:3]])
    assert record["noise"]["value"] == pytest.approx(NOISE, rel=0.05)
    assert np.std(np.einsum("nji,nj->ni", rotation, away) / error, axis=0) == pytest.approx(1.0, abs=0.1)
    assert len(record["speeds"][0]["names"]) == 6 and record["low_pass"] == 50.0
    assert "rudder: motion by markers" in (tmp_path / "r.html").read_text()
    path.with_suffix(".toml").write_text(f"{whole}[markers]\naero = true\n{axes}\n[markers.places.rudder]\n{at}")
    with pytest.raises(InputError, match="which vehicle's wings are the coefficients of"):
        identify.run(words)


def test_where_a_wing_is_not_seen_speeds_are_told_before_and_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tracks = capture()
    for name in PLACES["left_wing"]:
        tracks[name][300:330] = np.nan
    path = table(tmp_path, tracks)
    assert identify.run([str(path), "markers", "--map", str(path.with_suffix(".toml"))]) == 0
    out = capsys.readouterr().out
    assert "take.csv: 570 of 600 frames determined, 500 Hz" in out
    assert "in 2 records without a gap, low-passed at 50 Hz" in out
    assert "markers left wing: -0." in out and "standard error" in out


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("places.rudder]", "places.ruder]", "slow_hawk has no such body; it has: fuselage"),
        ("places.fuselage]", "places.elevator]", "the base has no markers"),
        ("nose = ", "tail_left = ", "tail_left is on two bodies"),
        ("nose = ", "beak = ", "fuselage: fewer than 20 frames in which three of its markers agree"),
        ("nose = [0.2,", "nose = [0.45,", "are 0.169 m apart, and 0.4.* m by markers.places.fuselage: is the unit"),
        ("cutoff = 50.0", "cutof = 50.0", "unknown key markers.cutof"),
        ('vehicle = "slow_hawk"', "", "which vehicle's bodies are the markers on"),
        ("[markers]", "[markers]\naxes = [[1,0,0],[0,1,0],[0,0,-1]]", "markers.axes must be a rotation"),
        ('nose_x = { column = "nose X", unit = "mm" }', "", "signals.nose_x must be there, in a unit of length"),
    ],
)
def test_a_map_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, old: str, new: str, expected: str) -> None:
    path = table(tmp_path, capture(100))
    mapping = path.with_suffix(".toml")
    text = mapping.read_text()
    if "axes" in new:
        text = "\n".join(line for line in text.splitlines() if not line.startswith("axes"))
    assert old in text
    mapping.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=expected) as refused:
        identify.run([str(path), "markers", "--map", str(mapping)])
    assert "\n" not in str(refused.value)


def positions(tracks: Capture) -> dict[str, NDArray[np.float64]]:
    return {body: np.stack([tracks[name] * UP / 1e3 for name in markers]) for body, markers in PLACES.items()}


def placed(wrong: float, seed: int) -> dict[str, dict[str, tuple[float, float, float]]]:
    """The places as they would be measured, ``wrong`` m off."""
    rng = np.random.default_rng(seed)
    return {
        body: {name: tuple(np.array(at) + wrong * rng.normal(size=3)) for name, at in markers.items()}
        for body, markers in PLACES.items()
    }


def test_exchanged_names_are_told_and_right_ones_are_not_doubted() -> None:
    tracks = capture(100)
    congruent = {frozenset(("shoulder_right", "shoulder_left")), *map(frozenset, combinations(PLACES["rudder"], 2))}
    for one, other in list(combinations(NAMES, 2))[::7]:
        found = find_swap(placed(0.001, 0), positions(tracks | {one: tracks[other], other: tracks[one]}))
        if frozenset((one, other)) in congruent:
            continue  # a triangle whose sides are as long within 3 mm
        assert found is not None and {found.one, found.other} == {one, other}
    assert all(find_swap(placed(0.002, seed), positions(tracks)) is None for seed in range(3))
    inexact = find_swap(placed(0.005, 5), positions(tracks))
    assert inexact is not None and inexact.named < POSITION_ERROR, "a doubt that is said, and refuses nothing"


def test_a_body_s_mirror_image_is_told_from_it() -> None:
    places = {
        "drone": {"nose": (0.1, 0.0, 0.0), "fin": (-0.1, 0.0, -0.08), "left": (0, -0.1, 0), "right": (0, 0.1, 0)}
    }
    rng = np.random.default_rng(0)
    observed = np.array(list(places["drone"].values()))[:, None] + 0.0008 * rng.normal(size=(4, 50, 3))
    assert find_swap(places, {"drone": observed}) is None
    found = find_swap(places, {"drone": observed[[0, 1, 3, 2]]})
    assert found is not None and {found.one, found.other} == {"left", "right"} and found.swapped < 0.0015
    exact = np.repeat(np.array(list(places["drone"].values()))[:, None], 50, axis=1)
    assert find_swap(places, {"drone": exact}) is None


@pytest.mark.parametrize(("one", "other"), [("tip_left", "spar_left"), ("tip_left", "tip_right")])
def test_a_capture_with_exchanged_names_is_refused(tmp_path: Path, one: str, other: str) -> None:
    tracks = capture(100)
    path = table(tmp_path, tracks | {one: tracks[other], other: tracks[one]})
    with pytest.raises(InputError, match="exchange the two") as refused:
        identify.run([str(path), "markers", "--map", str(path.with_suffix(".toml"))])
    assert one in str(refused.value) and other in str(refused.value)


def test_a_small_exchange_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tracks = capture(100)
    path = table(tmp_path, tracks | {"nose": tracks["shoulder_right"], "shoulder_right": tracks["nose"]})
    assert identify.run([str(path), "markers", "--map", str(path.with_suffix(".toml"))]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "with the names of nose and shoulder_right exchanged" in said and "inexact positions?" in said


def test_markers_without_a_map_or_in_a_log_without_them_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="markers needs --map"):
        identify.run(["capture.mcap", "markers"])
    mapping = tmp_path / "map.toml"
    mapping.write_text(EXAMPLE)
    with pytest.raises(InputError, match="is read by wingbeat identify FILE --map MAP"):
        identify.run(["take.csv", "--map", str(mapping)])
    assert identify.run(["--map-example", "markers"]) == 0
    assert capsys.readouterr().out == EXAMPLE
    path = nexus(tmp_path, capture(100))
    places = "".join(f"[markers.places.{body}]\nother_{body} = [0, 0, 0]\n" for body in PLACES)
    (tmp_path / "places.toml").write_text(f'[markers]\nvehicle = "slow_hawk"\n{places}')
    with pytest.raises(InputError, match=r"none of the map's markers under /mocap/; it has: .*nose"):
        identify.run([str(path), "markers", "--map", str(tmp_path / "places.toml")])
    with pytest.raises(InputError, match="markers takes --map"):
        identify.run([str(path), "markers", "--map", "m.toml", "--model", "a.toml"])
