"""C3D files of markers, written here in both kinds of numbers and both orders of bytes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import imported

from logs.reader import open_log
from wingbeat.errors import InputError

LABELS = ("nose", "tail")


def parameter(order: str, group: int, name: str, texts: tuple[str, ...], stated: tuple[int, ...] = ()) -> bytes:
    """A parameter of characters; ``stated`` are its dimensions where it lies."""
    width = max(map(len, texts))
    sizes = stated or (width, len(texts))
    body = bytes([255, len(sizes), *sizes]) + b"".join(text.ljust(width).encode() for text in texts) + b"\0"
    return struct.pack("bb", len(name), group) + name.encode() + struct.pack(f"{order}H", 2 + len(body)) + body


def c3d(
    order: str, floats: bool, up: str = "+Z", unit: str = "mm", frames: int = 50, stated: tuple[int, ...] = ()
) -> bytes:
    """Two markers at 100 Hz: one moves along x, one stands and is not seen in frames 10 to 19."""
    scale = -1.0 if floats else 0.5
    head = bytes([2, 0x50]) + struct.pack(f"{order}5HfHHf", 2, 0, 1, frames, 0, scale, 3, 0, 100.0)
    section = b"\1\x50\1" + bytes([84 if order == "<" else 86])
    section += struct.pack("bb", 5, -1) + b"POINT" + struct.pack(f"{order}H", 3) + b"\0"
    section += parameter(order, 1, "LABELS", LABELS) + parameter(order, 1, "UNITS", (unit,), stated)
    section += parameter(order, 1, "Y_SCREEN", (up,)) + b"\0\0"
    data = b""
    for n in range(frames):
        residual = -1.0 if 10 <= n < 20 else 1.0
        values = [10.0 * n, 200.0, 300.0, 1.0, -500.0, 40.0, 60.0, residual]
        if floats:
            data += struct.pack(f"{order}8f", *values)
        else:
            counts = [round(v if place % 4 == 3 else v / scale) for place, v in enumerate(values)]
            data += struct.pack(f"{order}8h", *counts)
    return head.ljust(512, b"\0") + section.ljust(512, b"\0") + data


def numbers(group: int, name: str, kind: int, sizes: tuple[int, ...], body: bytes) -> bytes:
    """A parameter of numbers, little endian."""
    body = struct.pack("bB", kind, len(sizes)) + bytes(sizes) + body + b"\0"
    return struct.pack("bb", len(name), group) + name.encode() + struct.pack("<H", 2 + len(body)) + body


def long_c3d(frames: int, counted: int, *, trial: bool = False, analog: int = 0) -> bytes:
    """Two markers of one label at 100 Hz; ``counted`` frames by the header; ``analog`` samples of two channels."""
    head = bytes([2, 0x50])
    head += struct.pack("<5HfHHf", 2, 2 * analog, 1, counted, 0, -1.0, 3, analog, 100.0)
    section = b"\1\x50\1" + bytes([84])
    for number, name in ((1, "POINT"), (2, "TRIAL"), (3, "ANALOG")):
        section += struct.pack("bb", len(name), -number) + name.encode() + struct.pack("<H", 3) + b"\0"
    section += parameter("<", 1, "LABELS", ("tip", "tip")) + parameter("<", 1, "UNITS", ("mm",))
    if trial:
        section += numbers(2, "ACTUAL_START_FIELD", 2, (2,), struct.pack("<2H", 1, 0))
        section += numbers(2, "ACTUAL_END_FIELD", 2, (2,), struct.pack("<2H", frames & 0xFFFF, frames >> 16))
    if analog:
        section += numbers(3, "USED", 2, (), struct.pack("<h", 2))
        section += numbers(3, "GEN_SCALE", 4, (), struct.pack("<f", 0.5))
        section += numbers(3, "SCALE", 4, (2,), struct.pack("<2f", 2.0, 4.0))
        section += numbers(3, "OFFSET", 2, (2,), struct.pack("<2h", 0, 10))
        section += parameter("<", 3, "LABELS", ("Fx", "Fz")) + parameter("<", 3, "UNITS", ("N", "N"))
    rows = np.zeros((frames, 8 + 2 * analog), "<f4")
    rows[:, :8] = (1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0, 0.0)
    rows[:, 0] = np.arange(frames) % 1000
    rows[:, 8:] = 30.0
    return head.ljust(512, b"\0") + (section + b"\0\0").ljust(512, b"\0") + rows.tobytes()


@pytest.mark.parametrize(
    ("counted", "trial"),
    [(65535, True), pytest.param(65535, False, marks=pytest.mark.validate), (70_000 - 65536, True)],
)
def test_more_frames_than_the_header_can_count(tmp_path: Path, counted: int, trial: bool) -> None:
    """GIVEN 70,000 frames and a header that saturates or wraps WHEN imported THEN all of them, of both markers."""
    out, report = imported(written(tmp_path, long_c3d(70_000, counted, trial=trial)), tmp_path)
    assert report.damage == ()
    with open_log(out) as log:
        assert len(log.columns("/mocap/tip").time) == len(log.columns("/mocap/tip_2").time) == 70_000


def test_analog_channels_are_imported(tmp_path: Path) -> None:
    """GIVEN two load cells with four samples a frame WHEN imported THEN scaled samples at 400 Hz."""
    out, _ = imported(written(tmp_path, long_c3d(50, 50, analog=4)), tmp_path)
    with open_log(out) as log:
        force = log.columns("/mocap/analog")
        assert len(force.time) == 200 and force.time[1] == pytest.approx(0.0025)
        assert set(force["Fx"]) == {30.0} and set(force["Fz"]) == {40.0}
        assert force.units["Fx"] == "N"


def test_a_marker_at_zero_was_not_seen(tmp_path: Path) -> None:
    """GIVEN a marker that is exactly zero in a frame WHEN imported THEN that frame is reported as not seen."""
    data = bytearray(long_c3d(50, 50))
    data[1024 + 20 * 32 : 1024 + 20 * 32 + 12] = bytes(12)
    _, report = imported(written(tmp_path, bytes(data)), tmp_path)
    assert [tuple(one) for one in report.dropped] == [("/mocap/tip", "not seen", 1)]


def written(folder: Path, data: bytes) -> Path:
    path = folder / "take.c3d"
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("floats", [True, False])
def test_markers_are_in_metres_and_ned_and_gaps_are_told(tmp_path: Path, order: str, floats: bool) -> None:
    out, report = imported(written(tmp_path, c3d(order, floats)), tmp_path)
    assert [tuple(one) for one in report.dropped] == [("/mocap/tail", "not seen", 10)] and report.damage == ()
    with open_log(out) as log:
        nose, tail = log.columns("/mocap/nose"), log.columns("/mocap/tail")
        assert nose["north"] == pytest.approx(0.01 * np.arange(50)) and nose.units["north"] == "m"
        assert set(np.round(nose["east"], 9)) == {-0.2} and set(np.round(nose["down"], 9)) == {-0.3}
        assert nose.time == pytest.approx(0.01 * np.arange(50)) and len(tail.time) == 40


def test_a_laboratory_whose_y_points_up(tmp_path: Path) -> None:
    out, _ = imported(written(tmp_path, c3d("<", True, up="+Y", unit="cm")), tmp_path)
    with open_log(out) as log:
        nose = log.columns("/mocap/nose")
        assert (nose["north"][1], nose["east"][1], nose["down"][1]) == pytest.approx((0.1, 3.0, -2.0))


def test_a_file_cut_off_gives_its_whole_frames_and_says_so(tmp_path: Path) -> None:
    out, report = imported(written(tmp_path, c3d("<", True)[:-40]), tmp_path)
    assert report.damage == ("cut off after 48 frames of 50",)
    with open_log(out) as log:
        assert len(log.columns("/mocap/nose").time) == 48


def test_what_is_no_whole_c3d_file_is_refused_in_one_line(tmp_path: Path) -> None:
    whole = c3d("<", True)
    decs = whole[:515] + bytes([85]) + whole[516:]
    for data, reason in (
        (b"text", "does not begin as"),
        (decs, "processor"),
        (whole[:1030], "no whole frame"),
        (whole[:2] + bytes(30) + whole[32:], "its head tells no frames"),
        (c3d("<", True, unit="in"), "its markers are in 'in'"),
    ):
        source = written(tmp_path, data)
        with pytest.raises(InputError, match=reason) as error:
            imported(source, tmp_path)
        assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == [source]


@pytest.mark.parametrize("seed", range(20))
def test_flipped_bytes_are_refused_in_one_line_or_read(tmp_path: Path, seed: int) -> None:
    source = np.random.default_rng(seed)
    data = np.frombuffer(c3d("<", True), np.uint8).copy()
    data[source.integers(0, 700, 8)] = source.integers(0, 256, 8)
    try:
        out, _ = imported(written(tmp_path, data.tobytes()), tmp_path)
    except InputError as reason:
        assert "\n" not in str(reason)
        return
    with open_log(out) as log:
        assert log.verify() == []


@pytest.mark.parametrize("sizes", [(1, 255, 255, 255, 255), (255,) * 20, (4, 255)])
def test_dimensions_of_a_parameter_that_the_file_cannot_have_are_refused(
    tmp_path: Path, sizes: tuple[int, ...]
) -> None:
    """GIVEN dimensions that tell more texts than there are bytes THEN one line, not hours and all memory."""
    source = written(tmp_path, c3d("<", True, frames=1, stated=sizes))
    with pytest.raises(InputError, match="POINT:UNITS has dimensions that do not fit into the file"):
        imported(source, tmp_path)


def test_a_text_of_no_length_is_no_text_however_often(tmp_path: Path) -> None:
    out, _ = imported(written(tmp_path, c3d("<", True, stated=(0, 255, 255, 255, 255))), tmp_path)
    with open_log(out) as log:
        assert log.columns("/mocap/nose").units["north"] == "m"


def test_a_head_that_tells_more_markers_than_any_laboratory_has_is_refused(tmp_path: Path) -> None:
    """Every pair of markers is looked at for a body: a damaged number of them would cost hours."""
    whole = c3d("<", True, frames=3000)
    with pytest.raises(InputError, match="its head tells no frames"):
        imported(written(tmp_path, whole[:2] + struct.pack("<H", 5000) + whole[4:]), tmp_path)
