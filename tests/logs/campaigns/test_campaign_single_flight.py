"""One flight of a campaign: its numbers are those of its log, and whatever goes wrong is a row."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from short_campaigns import SHORT, campaign_of

from avionics import topics
from avionics.messages import Stage
from avionics.vehicles import load_vehicle
from logs.campaigns import single_flight as module
from logs.campaigns.metrics import METRICS, measured
from logs.campaigns.outcome import Evaluation, Judged, Landing, Outcome, judge
from logs.campaigns.run import order_of
from logs.campaigns.single_flight import CannotRecord, Recording, fly_one
from logs.columns import Columns
from logs.reader import open_log
from logs.recorder import McapRecorder
from logs.replay.flight import replay_flight
from logs.summary import NEEDED, FlightSummary, Touchdown, summarize
from sim_bridge.flight.world import SimulatedWorld
from sim_bridge.topics import STATE
from wingbeat.topic import Topic

MODES = load_vehicle("robo_raven_ii_d").gains.modes


def test_the_numbers_of_a_flight_are_those_of_its_log_and_the_log_can_be_replayed(tmp_path: Path) -> None:
    text = '[flight]\nduration = 11\n"scale.gains.pitch.damping" = 1.3\n"wind.speed" = 1\n"throw.bank_deg" = 8\n'
    campaign = campaign_of(tmp_path, text)
    path = tmp_path / "flight.mcap"
    row = fly_one(order_of(campaign, 1, Recording(path)))
    assert (row["outcome"], row["failed"], row["log"]) == ("airborne", False, "flight.mcap")
    assert [p.name for p in tmp_path.glob("flight*")] == ["flight.mcap"]
    with open_log(path) as log:
        summary = summarize(log)
        tables = log.tables([topic.name for topic in NEEDED if topic.name in log.topics])
        assert {name: row[name] for name in METRICS} == pytest.approx(measured(summary, tables), nan_ok=True)
        assert replay_flight(log).same, "the gains of the campaign are in the log"
    assert row["bank"] > 0.1 and row["airtime"] == pytest.approx(11 - row["launch"])
    assert fly_one(order_of(campaign, 1)) == row | {"log": ""}, "without a log it is the same flight"


def test_a_log_is_kept_of_failed_flights_alone_where_that_was_asked(tmp_path: Path) -> None:
    campaign = campaign_of(tmp_path, SHORT)
    row = fly_one(order_of(campaign, 1, Recording(tmp_path / "failed.mcap", failed_only=True)))
    assert (row["failed"], row["log"]) == (True, "failed.mcap")
    fine = campaign_of(tmp_path, "[flight]\nduration = 8.5\n")
    row = fly_one(order_of(fine, 1, Recording(tmp_path / "fine.mcap", failed_only=True)))
    assert (row["failed"], row["log"]) == (False, "")
    assert sorted(path.name for path in tmp_path.glob("*.mcap*")) == ["failed.mcap"]


class FullDisk(McapRecorder):
    """A recorder whose disk is full in the end."""

    def close(self) -> None:
        super().close()
        self.failure = "recording ended: No space left on device"


def test_a_log_that_cannot_be_written_is_no_fault_of_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = campaign_of(tmp_path, SHORT)
    with pytest.raises(CannotRecord, match=r"cannot record to .*: Not a directory"):
        fly_one(order_of(campaign, 1, Recording(tmp_path / "short.toml" / "flight.mcap")))
    monkeypatch.setattr(module, "McapRecorder", FullDisk)
    with pytest.raises(CannotRecord, match="No space left"):
        fly_one(order_of(campaign, 1, Recording(tmp_path / "flight.mcap")))


def test_a_flight_that_is_never_launched_fails_and_says_so(tmp_path: Path) -> None:
    row = fly_one(order_of(campaign_of(tmp_path, SHORT), 1))
    assert (row["outcome"], row["failed"]) == ("not launched", True) and "0 s" in row["reason"]


def test_values_that_meet_badly_are_a_row(tmp_path: Path) -> None:
    order = order_of(campaign_of(tmp_path, SHORT), 1)
    row = fly_one(order._replace(values={**order.values, "vehicle.bodies.fuselage.mass": -1.0}))
    assert (row["outcome"], row["failed"]) == ("refused", True) and "outside" in row["reason"]
    assert all(row[name] is None for name in METRICS)


def test_an_exception_in_flight_is_a_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*arguments: object) -> None:
        raise ZeroDivisionError("a\nb")

    monkeypatch.setattr(module, "fly", broken)
    recording = Recording(tmp_path / "broken.mcap")
    row = fly_one(order_of(campaign_of(tmp_path, SHORT), 1, recording))
    assert (row["outcome"], row["reason"]) == ("error", "ZeroDivisionError: a b")
    assert row["log"] == "broken.mcap" and recording.path.exists()


def test_a_vehicle_that_is_nowhere_ends_its_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    step = SimulatedWorld._advance

    def lost(self: SimulatedWorld, *arguments: float) -> None:
        if self.time_us > 200_000:
            self.plant.y[0] = np.nan
        step(self, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(SimulatedWorld, "_advance", lost)
    row = fly_one(order_of(campaign_of(tmp_path, "[flight]\nduration = 300\n"), 1))
    assert (row["outcome"], row["failed"]) == ("not a number", True)


def table(topic: Topic, **fields: list[float]) -> Columns:
    columns = {name: np.array(values) for name, values in fields.items()}
    return Columns(topic.name, columns, {}, (columns["time_us"] * 1000).astype(np.int64), 0)


def judged(stage: Stage, sink: float, bank: float, north: float = 50.0, by_hand: bool = False) -> Evaluation:
    summary = FlightSummary(
        True, 60.0, 8.0, 40.0, None, 30.0, 200.0, 7.0, 4.0, 1.0, 1.0, 0, None,
        Touchdown(50.0, sink, 5.0, bank, 0.0), None,
    )  # fmt: skip
    tables = {
        STATE.name: table(STATE, time_us=[0.0, 5e7], north=[0.0, north], east=[0.0, 0.0]),
        topics.NAVIGATION.name: table(topics.NAVIGATION, time_us=[4e7, 4.99e7], stage=[float(stage)] * 2),
    }
    return judge(Judged(summary, tables, MODES, Landing(), by_hand))


def test_a_touchdown_is_a_landing_within_bounds_and_in_an_approach_alone() -> None:
    assert judged(Stage.FLARE, 1.9, 0.5).outcome is Outcome.LANDED
    assert judged(Stage.FLARE, 2.1, 0.0) == (Outcome.CRASHED, "touchdown with 2.1 m/s sink and 0 deg bank")
    assert judged(Stage.APPROACH, 1.0, -0.6).outcome is Outcome.CRASHED
    assert judged(Stage.EN_ROUTE, 1.0, 0.0) == (Outcome.CRASHED, "on the ground in EN_ROUTE")
    assert judged(Stage.EN_ROUTE, 1.0, 0.0, by_hand=True).outcome is Outcome.LANDED
    assert judged(Stage.FLARE, 1.0, 0.0, north=MODES.fence_radius + 1).outcome is Outcome.ASTRAY
    assert [judged(Stage.FLARE, sink, 0.0).failed for sink in (1.0, 3.0)] == [False, True]
