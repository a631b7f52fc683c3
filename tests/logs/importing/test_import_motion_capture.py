"""Motion capture: axes of both laboratories, what was not seen, and the onboard clock by the angular rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import imported

from avionics import messages as m
from avionics import topics
from avionics.state import zero
from logs.importing.clocks import Signal, align
from logs.importing.log_import import IMPORT, NOTES
from logs.importing.motion_capture import body_rates
from logs.reader import open_log
from logs.recorder import McapRecorder
from wingbeat.errors import InputError
from wingbeat.rotation_arrays import euler_from_quaternions, quaternions_from_euler

Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Times to positions NED (N, 3) and quaternions of r_ned_from_frd (N, 4)."""


def wandering(seed: int) -> Motion:
    """A bird that turns at random about all axes, up to 3 Hz."""
    source = np.random.default_rng(seed)
    tones = [(source.uniform(0.2, 3.0, 8), source.uniform(0, 6.28, 8)) for _ in range(3)]

    def motion(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angles = [
            sum(0.12 / f * np.sin(2 * np.pi * f * time + p) for f, p in zip(*tone, strict=True)) for tone in tones
        ]
        position = np.stack([1.0 + 0.5 * time, 0.2 * np.sin(time), -2.0 - 0.1 * time], axis=1)
        return position, np.stack(quaternions_from_euler(*angles), axis=1)

    return motion


def motive_csv(motion: Motion, seconds: float, start: float = 0.0, gap: range = range(0)) -> str:
    """An export in millimetres; ``start`` is the motion's time at the capture's first frame."""
    time = np.arange(0.0, seconds, 1.0 / 120.0)
    position, turn = motion(time + start)
    names = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    lines = [
        "Format Version,1.23,Take Name,bird,Export Frame Rate,120.000000,Rotation Type,Quaternion,"
        "Length Units,Millimeters,Coordinate Space,Global",
        "",
        ",,Type" + ",Rigid Body" * 8 + ",Marker" * 3,
        ",Name" + ",Bird" * 8 + ",Bird:tail" * 3,
        ",ID" + ",1" * 8 + ",2" * 3,
        ",," + ",".join(names) + ",Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z",
    ]
    for n, at in enumerate(time):
        (north, east, down), (w, x, y, z) = position[n] * 1e3, turn[n]
        # Motive's y is up: x, y, z are north, up, east.
        body = [x, -z, y, w, north, -down, east, 0.1]
        cells = [""] * 8 if n in gap else [f"{value:.7f}" for value in body]
        lines.append(",".join([str(n), f"{at:.6f}", *cells, f"{north:.3f}", f"{-down:.3f}", f"{east:.3f}"]))
    return "\n".join(lines)


def nexus_csv(motion: Motion, seconds: float) -> str:
    time = np.arange(0.0, seconds, 0.01)
    position, turn = motion(time)
    lines = ["Segments", "100", ",,Global Angle Bird:Body,,,,,", "Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ"]
    lines.append(",,deg,deg,deg,mm,mm,mm")
    for n in range(len(time)):
        (north, east, down), (w, x, y, z) = position[n] * 1e3, turn[n]
        half = math.acos(min(max(w, -1.0), 1.0))
        by = math.degrees(2.0 * half) / max(math.sin(half), 1e-12)
        lines.append(f"{n + 1},0,{by * x:.7f},{-by * y:.7f},{-by * z:.7f},{north:.4f},{-east:.4f},{-down:.4f}")
    lines += ["", "Trajectories", "100", ",,Bird:tail,,", "Frame,Sub Frame,X,Y,Z", ",,mm,mm,mm", "1,0,1000,0,500"]
    return "\n".join(lines)


def written(folder: Path, text: str) -> Path:
    path = folder / "take.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize("export", [motive_csv, nexus_csv])
def test_attitude_and_place_are_those_of_the_bird(tmp_path: Path, export: Callable[[Motion, float], str]) -> None:
    motion = wandering(3)
    out, report = imported(written(tmp_path, export(motion, 5.0)), tmp_path)
    assert report.dropped == ()
    with open_log(out) as log:
        attitude, place, height = (log.columns(t) for t in (topics.ATTITUDE, topics.POSITION, topics.ALTITUDE))
        position, turn = motion(attitude.time)
        for name, angle in zip(("roll", "pitch", "yaw"), euler_from_quaternions(*turn.T), strict=True):
            assert attitude[name] == pytest.approx(angle, abs=2e-6)
        assert place["north"] == pytest.approx(position[:, 0], abs=1e-5)
        assert place["east"] == pytest.approx(position[:, 1], abs=1e-5)
        assert height["altitude"] == pytest.approx(-position[:, 2], abs=1e-5)
        assert height["climb_rate"] == pytest.approx(0.1, abs=1e-3)
        assert place["v_north"] == pytest.approx(0.5, abs=1e-3)
        assert "/mocap/Bird_tail" in log.topics


def test_body_rates_are_those_of_the_turning_body() -> None:
    """A coning body: heading turns steadily while it is banked, so that its rates are constant in body axes."""
    time = np.arange(0.0, 2.0, 0.01)
    roll = np.full_like(time, 0.5)
    rates = body_rates(time, np.stack(quaternions_from_euler(roll, 0.0 * time, 1.2 * time), axis=1))[1:-1]
    expected = [0.0, 1.2 * math.sin(0.5), 1.2 * math.cos(0.5)]
    assert rates == pytest.approx(np.tile(expected, (len(rates), 1)), abs=1e-4)


def test_frames_in_which_it_was_not_seen_are_told(tmp_path: Path) -> None:
    source = written(tmp_path, motive_csv(wandering(1), 2.0, gap=range(100, 130)))
    out, report = imported(source, tmp_path)
    assert [tuple(one) for one in report.dropped] == [("/mocap/Bird", "not seen", 30)]
    with open_log(out) as log:
        assert len(log.columns(topics.ATTITUDE).time) == 210 and len(log.columns("/mocap/Bird_tail").time) == 240


def onboard(path: Path, motion: Motion, boot: float, seconds: float) -> Path:
    """A flight's log: its gyro has a bias and noise; ``boot`` is the motion's time at its clock's zero."""
    time = np.arange(0.0, seconds, 0.005)
    rates = body_rates(time, motion(time + boot)[1])
    rates += np.random.default_rng(5).normal(0.01, 0.03, rates.shape)
    with McapRecorder(path, start_epoch_ns=1_700_000_000_000_000_000) as recorder:
        for at, row in zip(time[1:-1], rates[1:-1], strict=True):
            sample = zero(m.ImuSample)._replace(time_us=round(at * 1e6), gyro_x=row[0], gyro_y=row[1], gyro_z=row[2])
            recorder.record(topics.IMU, sample)
    return path


@pytest.mark.parametrize("offset", [12.3456, -3.21])
def test_a_take_goes_on_the_clock_of_the_onboard_log(tmp_path: Path, offset: float) -> None:
    """GIVEN a take that began ``offset`` seconds behind the boot THEN its times are the onboard ones, to 2 ms."""
    motion = wandering(7)
    log = onboard(tmp_path / "flight.mcap", motion, 0.0, 30.0)
    out, _ = imported(written(tmp_path, motive_csv(motion, 12.0, start=offset)), tmp_path, onboard=log)
    with open_log(out) as aligned:
        attitude = aligned.columns(topics.ATTITUDE)
        expected = euler_from_quaternions(*motion(attitude.time)[1].T)[1]
        shift = np.gradient(expected, attitude.time)
        error = float(np.sum((attitude["pitch"] - expected) * shift) / np.sum(shift**2))
        assert abs(error) < 0.002
        assert attitude.time[0] >= 0.0 and aligned.boot_ns == 1_700_000_000_000_000_000
        assert "flight.mcap" in aligned.metadata[IMPORT]["clock"]


def test_clocks_of_two_motions_are_not_put_together(tmp_path: Path) -> None:
    log = onboard(tmp_path / "flight.mcap", wandering(7), 0.0, 20.0)
    source = written(tmp_path, motive_csv(wandering(8), 10.0))
    with pytest.raises(InputError, match="cannot be aligned"):
        imported(source, tmp_path, onboard=log)
    assert sorted(tmp_path.iterdir()) == sorted((log, source))


def test_a_motion_that_repeats_itself_fits_at_several_offsets_and_is_refused() -> None:
    time = np.arange(0.0, 20.0, 0.005)
    flapping = 2.0 + np.sin(2 * np.pi * 4.0 * time)
    with pytest.raises(InputError, match="several offsets"):
        align(Signal(time[:1200], flapping[:1200]), Signal(time, flapping))
    with pytest.raises(InputError, match="less than 3 s"):
        align(Signal(time[:20], flapping[:20]), Signal(time, flapping))


def test_exports_that_are_not_whole_are_refused_in_one_line(tmp_path: Path) -> None:
    whole, nexus = motive_csv(wandering(1), 1.0), nexus_csv(wandering(1), 1.0)
    for text, reason in (
        ("Format Version,1.23\n", "no line of column names"),
        ("\n".join(whole.splitlines()[:7]), "no frame in it"),
        (whole.replace("Quaternion", "XYZ"), "not quaternions"),
        ("Segments\nfast\n,,A\nFrame\n,\n1\n", "rate of a part"),
        ("Devices\n1000\n", "no body and no marker"),
        (whole.replace("Millimeters", "Inches"), "Length Units are 'Inches'"),
        (nexus.replace(",,deg,deg,deg,mm,mm,mm", ",,rad,rad,rad,mm"), "TY of Global Angle Bird:Body is in ''"),
        (nexus.replace(",,deg,deg,deg,mm,mm,mm", ",,deg,deg,deg,,mm,mm"), "TX of .* is in ''"),
        (nexus.replace(",,deg,deg,deg,mm,mm,mm", ",,deg,mm,deg,mm,mm,mm"), "RY of .* where a unit of rad must be"),
    ):
        with pytest.raises(InputError, match=reason) as error:
            imported(written(tmp_path, text), tmp_path)
        assert "\n" not in str(error.value)


def trajectories_csv(motion: Motion, seconds: float, start: float) -> str:
    """Markers alone, as Nexus exports them: four on the fuselage, one at a wing's tip that flaps."""
    time = np.arange(0.0, seconds, 0.01)
    position, turn = motion(time + start)
    flap = 0.5 * np.sin(2 * np.pi * 4.0 * time)
    still = [(0.1, 0.0, 0.0), (-0.2, 0.0, 0.0), (0.0, 0.05, 0.0), (0.0, -0.05, -0.03)]
    own = [np.broadcast_to(place, (len(time), 3)) for place in still]
    own.append(np.stack([0.0 * time, 0.4 * np.cos(flap), -0.4 * np.sin(flap)], axis=1))
    w, v = turn[:, :1], turn[:, 1:]
    markers = [p + 2.0 * np.cross(v, np.cross(v, p) + w * p) + position for p in own]
    labels = ["nose", "tail", "left", "right", "tip"]
    lines = ["Trajectories", "100", ",," + ",,,".join(labels) + ",,", "Frame,Sub Frame" + ",X,Y,Z" * 5]
    lines.append("," + ",mm,mm,mm" * 5)
    for n in range(len(time)):
        cells = [f"{north:.4f},{-east:.4f},{-down:.4f}" for north, east, down in (m[n] * 1e3 for m in markers)]
        lines.append(",".join([str(n + 1), "0", *cells]))
    return "\n".join(lines)


def test_markers_alone_have_a_body_which_goes_on_the_onboard_clock(tmp_path: Path) -> None:
    motion = wandering(7)
    log = onboard(tmp_path / "flight.mcap", motion, 0.0, 30.0)
    out, _ = imported(written(tmp_path, trajectories_csv(motion, 12.0, start=9.87)), tmp_path, onboard=log)
    with open_log(out) as aligned:
        attitude = aligned.columns(topics.ATTITUDE)
        assert attitude.time[0] == pytest.approx(9.87, abs=0.004)
        assert aligned.metadata[NOTES]["body"] == "found among the markers: nose, tail, left, right"
        rates = body_rates(attitude.time, motion(attitude.time)[1])[5:-5]
        size = np.sqrt(sum(attitude[f"{axis}_rate"][5:-5] ** 2 for axis in ("roll", "pitch", "yaw")))
        assert size == pytest.approx(np.linalg.norm(rates, axis=1), abs=0.1)
