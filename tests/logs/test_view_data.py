"""What a page is told: that it looks like the log, says what it lacks, and brings everything with it."""

from __future__ import annotations

import base64
import json
import math
import re
import zlib
from pathlib import Path
from typing import Any

import circling
import numpy as np
import pytest
from circling import ONBOARD, flap, messages, place
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from recorded import EPOCH_NS
from scipy.spatial.transform import Rotation

from avionics import messages as m
from avionics import topics
from logs.poses import enu_from_flu
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.view import tables as view_tables
from logs.view.motion import Motion, motion_of
from logs.view.packing import ABSENT, Packer
from logs.view.page import write_page
from logs.view.panels import PANELS, Series, bands
from logs.view.tables import Tables, read_tables
from logs.view.thinning import thinned
from sim_bridge import topics as truth_topics
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity
from wingbeat.topic import Topic

Array = NDArray[np.float64]
NAN = math.nan


def simulate(path: Path, flight: Any, events: tuple[tuple[float, str], ...] = ()) -> Path:
    with McapRecorder(path, start_epoch_ns=EPOCH_NS, clock=lambda: 0.0) as recorder:
        recorder.note("flight", {"vehicle": "robo_raven_ii_d"})
        for topic, message in flight:
            recorder.record(topic, message)
        for time, text in events:
            recorder.record(topics.EVENTS, Event(round(time * 1e6), Severity.INFO, "main", text))
    assert not recorder.refusal and not recorder.failure
    return path


def tables_of(path: Path, flight: Any) -> Tables:
    with open_log(simulate(path, flight)) as log:
        return read_tables(log)


def slowed(topic: Topic, rate: float) -> Any:
    """A topic's messages at another rate, as telemetry gives them."""
    every = round(topic.rate / rate)
    return [entry for n, entry in enumerate(messages(10.0, (topic,))) if n % every == 0]


def unpacked(packer: Packer, where: dict[str, float]) -> Array:
    """What `decode.js` does."""
    raw = np.frombuffer(zlib.decompress(base64.b64decode(packer.text())), np.uint8)
    at, count, width = (int(where[name]) for name in ("at", "count", "width"))
    planes = raw[at : at + count * width].reshape(width, count)
    change = np.ascontiguousarray(planes.T).view(f"<i{width}").ravel()
    whole = np.cumsum(change, dtype=change.dtype)
    return np.where(whole == ABSENT[width], np.nan, where["middle"] + where["step"] * whole)


def described(page: Path) -> Any:
    return json.loads(re.findall(r'id="flight">(.*?)</script>', page.read_text(encoding="utf-8"), re.S)[0])


# --- numbers ------------------------------------------------------------------------------------------------


@given(st.lists(st.floats(-1e6, 1e6) | st.just(NAN) | st.just(math.inf), max_size=50))
def test_a_column_comes_back_within_half_a_step(values: list[float]) -> None:
    packer = Packer()
    packer.add(np.arange(5.0))
    where = packer.add(np.array(values))
    found, wanted = unpacked(packer, where), np.where(np.isfinite(values), values, np.nan)
    assert found == pytest.approx(wanted, abs=0.501 * where["step"], nan_ok=True)


@given(st.lists(st.floats(-1e5, 1e5) | st.just(NAN), max_size=50))
def test_a_column_of_a_given_step_comes_back_to_that_step(values: list[float]) -> None:
    packer = Packer()
    where = packer.add(np.array(values), 1e-3)
    assert unpacked(packer, where) == pytest.approx(np.array(values), abs=0.51e-3, nan_ok=True)


def test_an_hour_of_times_is_packed_into_next_to_nothing() -> None:
    packer = Packer()
    packer.add(np.arange(0.0, 3600.0, 0.005), 1e-4)
    assert len(packer.text()) < 20_000


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=300), st.integers(1, 50))
def test_thinning_keeps_the_extremes_and_the_limit(values: list[float], limit: int) -> None:
    time, series = np.arange(len(values)) * 0.01, np.array(values)
    found = thinned(time, {"x": series}, limit)
    low, high = found.low["x"], (found.high or found.low)["x"]
    assert len(found.time) <= limit
    assert (np.min(low), np.max(high)) == (np.min(series), np.max(series))
    assert np.all(low <= high) and np.all(np.diff(found.time) >= 0.0)
    assert (found.high is None) == (len(values) <= limit)


@pytest.mark.parametrize("limit", [1000, 40])
def test_no_line_is_drawn_over_a_gap(limit: int) -> None:
    time = np.concatenate([np.arange(100) * 0.01, 5.0 + np.arange(100) * 0.01])
    found = thinned(time, {"x": np.ones(200)}, limit)
    (gap,) = np.flatnonzero(np.isnan(found.low["x"]))
    assert found.time[gap] < 1.0 and found.time[gap + 1] >= 5.0
    assert len(found.time) == min(limit, 200) + 1


def test_samples_without_numbers_do_not_hide_their_neighbours() -> None:
    found = thinned(np.arange(6.0), {"x": np.array([NAN, 2.0, 3.0, NAN, NAN, NAN])}, 3)
    assert found.high is not None
    assert found.low["x"] == pytest.approx([2.0, 3.0, NAN], nan_ok=True)
    assert found.high["x"] == pytest.approx([2.0, 3.0, NAN], nan_ok=True)


# --- motion -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def true_tables(tmp_path_factory: pytest.TempPathFactory) -> Tables:
    return tables_of(tmp_path_factory.mktemp("view") / "a.mcap", messages(40.0))


def test_the_bird_is_where_the_truth_was(true_tables: Tables) -> None:
    body = motion_of(true_tables).body
    assert body is not None and len(body.time) == pytest.approx(40.0 * 50.0, abs=3)
    wanted = np.array([place(t) for t in body.time]).T
    assert body.place == pytest.approx(np.array([wanted[1], wanted[0], -wanted[2]]), abs=0.01)
    assert body.tail == pytest.approx(np.broadcast_to([[0.05], [0.02]], body.tail.shape))


def test_the_bird_points_where_the_truth_did_all_the_way_round(true_tables: Tables) -> None:
    body = motion_of(true_tables).body
    assert body is not None
    wanted = [enu_from_flu(circling._turn(t)) for t in body.time]
    between = (
        Rotation.from_quat(body.quaternion.T, scalar_first=True) * Rotation.from_quat(wanted, scalar_first=True).inv()
    )
    assert np.max(between.magnitude()) < 2e-3
    # A page interpolates between neighbours: none may be the other of the two quaternions of its attitude.
    assert np.all(np.sum(body.quaternion[:, 1:] * body.quaternion[:, :-1], axis=0) > 0.99)


def test_the_wings_flap_as_they_did(true_tables: Tables) -> None:
    wings = motion_of(true_tables).wings
    assert wings is not None and len(wings.time) == pytest.approx(40.0 * 200.0, abs=3)
    assert wings.flap[0] == pytest.approx([flap(t) for t in wings.time], abs=1e-3)
    assert np.all(wings.twist == pytest.approx(0.1))


def test_the_believed_track_is_shown_beside_the_true_one(true_tables: Tables) -> None:
    found = motion_of(true_tables)
    assert found.estimated is not None and found.missing == []
    time, track = found.estimated
    wanted = np.array([place(t) for t in time]).T
    # The believed altitude counts from boot: the true place's at the first sample is added.
    assert track == pytest.approx(np.array([wanted[1], wanted[0], -wanted[2]]), abs=0.02)


def estimated_motion(tmp_path: Path, *left_out: Topic) -> Motion:
    chosen = tuple(topic for topic in ONBOARD if topic not in left_out)
    return motion_of(tables_of(tmp_path / "a.mcap", messages(5.0, chosen)))


def test_without_truth_the_bird_is_where_it_was_believed_to_be(tmp_path: Path) -> None:
    found = estimated_motion(tmp_path)
    assert found.body is not None and found.estimated is None and found.missing == []
    north, east, _ = place(float(found.body.time[-1]))
    assert found.body.place[:, -1] == pytest.approx([east, north, 2.5], abs=0.1)


def test_what_is_not_known_is_at_rest_and_said(tmp_path: Path) -> None:
    found = estimated_motion(tmp_path, topics.POSITION, topics.ALTITUDE, topics.WING)
    assert found.body is not None and found.wings is None
    assert np.all(found.body.place == 0.0)
    assert [words.split(" (")[0] for words in found.missing] == ["position", "altitude", "wing angles"]


def test_without_an_attitude_there_is_no_bird(tmp_path: Path) -> None:
    found = estimated_motion(tmp_path, topics.ATTITUDE)
    assert found.body is None and found.missing == ["attitude (the vehicle is not drawn)"]


def test_fixes_tell_the_place_where_no_estimate_does(tmp_path: Path) -> None:
    fix = m.GpsFix(0, 0.8, 0.2, 100.0, 0.0, 0.0, 0.0, 1.0, 1.0, 3, 9)
    steps = [fix._replace(time_us=n * 200_000 + 5000, latitude=0.8 + n * 1e-6, altitude=100.0 + n) for n in range(25)]
    flight = [*messages(5.0, (topics.ATTITUDE,)), *((topics.GPS, step) for step in steps)]
    body = motion_of(tables_of(tmp_path / "a.mcap", flight)).body
    assert body is not None
    assert body.place[:, -1] == pytest.approx([0.0, 24 * 6.371, 24.0], abs=0.01)


def test_strokes_are_redrawn_from_telemetry_too_rare_to_show_them(tmp_path: Path) -> None:
    flight = [*messages(10.0, (topics.ATTITUDE,)), *slowed(topics.WING, 10.0)]
    wings = motion_of(tables_of(tmp_path / "a.mcap", flight)).wings
    assert wings is not None and len(wings.time) > 10.0 * 20 * circling.FREQUENCY * 0.9
    # Ten samples a second of four strokes a second: the angles alone would show two strokes.
    assert wings.flap[1] == pytest.approx([flap(t) for t in wings.time], abs=1e-6)


def test_wings_that_stand_still_are_not_redrawn(tmp_path: Path) -> None:
    glide = [
        (topic, w._replace(frequency=0.0, amplitude_left=0.5, angle_left=0.2) if w.time_us > 5e6 else w)
        for topic, w in slowed(topics.WING, 10.0)
    ]
    wings = motion_of(tables_of(tmp_path / "a.mcap", glide)).wings
    assert wings is not None
    assert np.all(wings.flap[0][wings.time > 5.2] == pytest.approx(0.2))


# --- reading ------------------------------------------------------------------------------------------------


def test_a_log_read_in_slices_is_the_log_read_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[float] = []
    with open_log(simulate(tmp_path / "a.mcap", messages(5.0))) as log:
        whole = read_tables(log)
        monkeypatch.setattr(view_tables, "SLICE", 0.7)
        sliced = read_tables(log, lambda done, note: told.append(done))
    assert whole.keys() == sliced.keys() and len(told) == 8 and told == sorted(told)
    for name, table in whole.items():
        assert np.array_equal(table.time, sliced[name].time)
        assert all(np.array_equal(values, sliced[name].fields[field]) for field, values in table.fields.items())


def test_modes_and_stages_are_stretches_with_their_names(true_tables: Tables) -> None:
    modes, stages = bands(true_tables, "mode", 40.0), bands(true_tables, "stage", 40.0)
    assert [band.label for band in modes] == ["stabilized", "auto"]
    assert [band.label for band in stages] == ["wait launch", "climb out"]
    assert modes[0].end == modes[1].start == pytest.approx(1.0) and stages[1].end == 40.0


# --- pages --------------------------------------------------------------------------------------------------


def test_a_page_brings_everything_with_it(tmp_path: Path) -> None:
    with open_log(simulate(tmp_path / "a.mcap", messages(5.0), ((1.0, "armed"), (3.0, "launched")))) as log:
        page = write_page(log, tmp_path / "a.html")
    text = page.path.read_text(encoding="utf-8")
    assert not re.search(r"(?<!/\*! )https?://|<link rel=\"stylesheet|\bsrc=|@import", text)
    assert page.panels == [panel.title for panel in PANELS]
    assert (page.events, page.missing, page.bytes) == (2, [], page.path.stat().st_size)
    document = described(page.path)
    assert [event["text"] for event in document["events"]] == ["armed", "launched"]
    assert document["vehicle"] == "robo_raven_ii_d" and document["date"] == "2023-11-14T22:13:20+00:00"
    assert document["shape"]["semispan"] > 0.1


def test_true_and_measured_power_say_over_which_time_they_are_means(tmp_path: Path) -> None:
    with open_log(simulate(tmp_path / "a.mcap", messages(5.0))) as log:
        found = Series(read_tables(log), Packer()).panels()
    power = next(panel for panel in found if panel["title"] == "Power")
    assert [line["name"] for line in power["lines"]] == ["truth, mean of 5 ms", "measured, mean of 10 ms"]


def test_a_real_aircrafts_page_says_what_its_log_lacks(tmp_path: Path) -> None:
    chosen = (topics.ATTITUDE, topics.ALTITUDE, topics.POSITION)
    with open_log(simulate(tmp_path / "a.mcap", messages(5.0, chosen))) as log:
        page = write_page(log, tmp_path / "a.html")
    assert page.panels == ["Roll", "Pitch", "Yaw", "Altitude above the place of boot"]
    assert page.missing[0] == "truth" and {"airspeed", "power", "battery", "modes"} <= set(page.missing)
    assert sum("wing" in words for words in page.missing) == 1


def test_a_vehicle_file_of_another_version_does_not_keep_a_flight_from_being_seen(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "a.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: 0.0) as recorder:
        recorder.attach("world_vehicle.toml", "application/toml", b"[wings_of_old]\nspan = 1.0\n")
        for topic, message in messages(1.0):
            recorder.record(topic, message)
    with open_log(recorder.path) as log:
        page = write_page(log, tmp_path / "a.html")
    assert page.missing == ["the vehicle's shape (a generic vehicle is drawn)"]
    assert described(page.path)["vehicle"] == "unknown vehicle"


def test_what_an_event_says_cannot_leave_its_place(tmp_path: Path) -> None:
    text = '</script><script>alert("x")</script> {{ numbers }}'
    with open_log(simulate(tmp_path / "a.mcap", messages(1.0), ((0.5, text),))) as log:
        page = write_page(log, tmp_path / "a.html")
    assert described(page.path)["events"][0]["text"] == text
    content = page.path.read_text(encoding="utf-8")
    assert content.count("<script") == 3
    assert re.search(r"script-src 'sha256-[\w+/=]+'; style-src", content.replace("&#39;", "'"))


def test_a_log_with_nothing_to_show_is_refused(tmp_path: Path) -> None:
    path = simulate(tmp_path / "a.mcap", (), ((0.5, "armed"),))
    with open_log(path) as log, pytest.raises(InputError, match="no topics for a page"):
        write_page(log, tmp_path / "a.html")
    assert not (tmp_path / "a.html").exists()


def test_an_existing_page_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text("mine")
    with open_log(simulate(tmp_path / "a.mcap", messages(1.0))) as log, pytest.raises(InputError, match="exists"):
        write_page(log, tmp_path / "a.html")
    assert (tmp_path / "a.html").read_text() == "mine"


def test_a_truth_without_an_attitude_gives_way_to_what_was_believed(tmp_path: Path) -> None:
    flight = [
        (topic, message._replace(quaternion_w=NAN) if topic is truth_topics.STATE else message)
        for topic, message in messages(2.0)
    ]
    with open_log(simulate(tmp_path / "a.mcap", flight)) as log:
        page = write_page(log, tmp_path / "a.html")
    document = described(page.path)
    assert page.missing == ["truth"] and document["motion"]["estimated"] is None
    assert [line["name"] for line in document["panels"][0]["lines"]] == ["setpoint", "estimate"]
