"""A flight for Rerun, read back with its own reader: the bird moves as in the log, and the plots are the log's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from circling import messages
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from numpy.typing import NDArray
from recorded import EPOCH_NS

from avionics import topics
from logs.export import Part, export
from logs.outline import shape_of
from logs.poses import wing_in_body
from logs.reader import Log, open_log
from logs.recorder import McapRecorder
from logs.rrd import BIRD, PLACE
from logs.scene import SceneRecorder, outlines
from sim_bridge import topics as truth_topics
from sim_bridge.vehicles import load_vehicle
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity

pytest.importorskip("rerun", reason="rerun-sdk is not installed: pip install rerun-sdk")
chunk = pytest.importorskip("rerun.chunk")

Array = NDArray[np.float64]
SHAPE = shape_of(load_vehicle("robo_raven_ii_d"))
EVENTS = ((1.0, Severity.INFO, "armed"), (6.0, Severity.CRITICAL, "the battery is empty"))


class Drawn:
    """An rrd file: rows of an entity's components, and what is still."""

    def __init__(self, path: Path) -> None:
        self.times: dict[str, Array] = {}
        self.columns: dict[str, Array] = {}
        for part in chunk.RrdReader(path).stream().to_chunks():
            batch = part.to_record_batch()
            for name in batch.schema.names:
                if name == "flight":
                    self.times[part.entity_path] = batch.column(name).cast("int64").to_numpy() * 1e-9
                elif ":" in name:
                    values = np.array(batch.column(name).to_pylist())
                    self.columns[f"{part.entity_path} {name.rpartition(':')[2]}"] = values.squeeze()

    def at(self, entity: str, component: str, times: Array) -> Array:
        """A component's rows at other times, (n,) or (n, k)."""
        rows = self.columns[f"{entity} {component}"].reshape(len(self.times[entity]), -1)
        return np.array([np.interp(times, self.times[entity], row) for row in rows.T]).T.squeeze()


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Log:
    path = tmp_path_factory.mktemp("rrd") / "flight.mcap"
    with McapRecorder(path, start_epoch_ns=EPOCH_NS, clock=lambda: 0.0) as recorder:
        recorder.note("flight", {"vehicle": "robo_raven_ii_d"})
        seen = SceneRecorder(recorder, SHAPE, EPOCH_NS)
        for topic, message in messages(20.0):
            seen.record(topic, message)
        for time, severity, text in EVENTS:
            seen.record(topics.EVENTS, Event(round(time * 1e6), severity, "main", text))
    return open_log(path)


@pytest.fixture(scope="module")
def drawn(flight: Log) -> Drawn:
    (path,) = export(flight, flight.path.with_suffix(".rrd")).files
    return Drawn(path)


def transforms(log: Log) -> list[Any]:
    """What viewers of MCAP are shown."""
    with log.path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return [decoded for *_, decoded in reader.iter_decoded_messages(topics=["/view/transforms"])]


def test_the_bird_moves_as_the_logs_transforms_say(flight: Log, drawn: Drawn) -> None:
    bodies = [frames.transforms[0] for frames in transforms(flight)]
    times = np.array([body.timestamp.ToNanoseconds() - EPOCH_NS for body in bodies]) * 1e-9
    places = np.array([(b.translation.x, b.translation.y, b.translation.z) for b in bodies])
    turned = np.array([(b.rotation.x, b.rotation.y, b.rotation.z, b.rotation.w) for b in bodies])
    assert len(times) == 1000 and np.ptp(places, axis=0).max() > 10.0
    assert drawn.at(PLACE, "translation", times) == pytest.approx(places, abs=2e-3)
    found = drawn.at(BIRD, "quaternion", times)
    assert np.abs(np.sum(found * turned, axis=1)) == pytest.approx(np.ones(len(times)), abs=1e-5)


def test_the_wings_flap_about_their_hinges_as_they_were_recorded(flight: Log, drawn: Drawn) -> None:
    wing = flight.columns(truth_topics.WING)
    for name, side in (("left_wing", 1), ("right_wing", -1)):
        angles = zip(wing[f"angle_{name[:-5]}"], wing[f"twist_{name[:-5]}"], strict=True)
        w, x, y, z = np.array([wing_in_body(flap, twist, side) for flap, twist in angles]).T
        found = drawn.at(f"{BIRD}/{name}", "quaternion", wing.time)
        assert np.ptp(x) > 0.1 and found == pytest.approx(np.array([x, y, z, w]).T, abs=1e-3)
        hinge = drawn.at(f"{BIRD}/{name}", "translation", wing.time[:1])
        assert hinge == pytest.approx((SHAPE.hinge[0], side * SHAPE.hinge[1], SHAPE.hinge[2]))
        corners = drawn.columns[f"{BIRD}/{name} vertex_positions"]
        assert corners == pytest.approx(np.concatenate(outlines(SHAPE)[name]))


def test_plots_events_and_track_are_the_logs(flight: Log, drawn: Drawn) -> None:
    power, attitude = flight.columns(topics.POWER), flight.columns(topics.ATTITUDE)
    assert drawn.columns["/voltage/measured scalars"] == pytest.approx(power["voltage"])
    assert drawn.times["/voltage/measured"] == pytest.approx(power.time)
    assert drawn.columns["/pitch/estimate scalars"] == pytest.approx(np.degrees(attitude["pitch"]))
    assert drawn.columns["/events text"].tolist() == [f"main: {text}" for _, _, text in EVENTS]
    assert drawn.columns["/events level"].tolist() == ["INFO", "ERROR"]
    track = drawn.columns["/world/track strips"]
    assert track == pytest.approx(drawn.columns[f"{PLACE} translation"], abs=1e-5)


def test_it_takes_no_part_and_shows_nothing_of_nothing(flight: Log, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="rrd holds the whole flight: it takes no topics, times or rate"):
        export(flight, tmp_path / "a.rrd", Part(start=1.0))
    with McapRecorder(tmp_path / "empty.mcap", start_epoch_ns=EPOCH_NS):
        pass
    with open_log(tmp_path / "empty.mcap") as empty, pytest.raises(InputError, match="none of the topics"):
        export(empty, tmp_path / "a.rrd")
    assert not (tmp_path / "a.rrd").exists()


def test_what_is_believed_is_drawn_where_nothing_truer_is_known(tmp_path: Path) -> None:
    known = (topics.ATTITUDE, topics.POSITION, topics.ALTITUDE)
    with McapRecorder(tmp_path / "real.mcap", start_epoch_ns=EPOCH_NS, clock=lambda: 0.0) as recorder:
        for topic, message in messages(5.0, known):
            recorder.record(topic, message)
    with open_log(tmp_path / "real.mcap") as log:
        found = Drawn(export(log, tmp_path / "real.rrd").files[0])
        height = log.columns(topics.ALTITUDE)
    up = found.at(PLACE, "translation", height.time[10:-10])[:, 2]
    assert up == pytest.approx(height["altitude"][10:-10], abs=2e-3) and np.ptp(up) > 0.0
    # Nobody told of its wings: they are there, at rest.
    assert found.columns[f"{BIRD}/left_wing quaternion"].tolist() == [0.0, 0.0, 0.0, 1.0]
    assert "/wing_angle/left scalars" not in found.columns


def test_a_log_of_events_alone_is_shown_without_a_bird(tmp_path: Path) -> None:
    with McapRecorder(tmp_path / "said.mcap", start_epoch_ns=EPOCH_NS) as recorder:
        recorder.record(topics.EVENTS, Event(10**6, Severity.INFO, "main", "armed"))
    with open_log(tmp_path / "said.mcap") as log:
        (path,) = export(log, tmp_path / "new" / "said.rrd").files
    found = Drawn(path)
    assert found.columns["/events text"] == "main: armed" and f"{PLACE} translation" not in found.columns
