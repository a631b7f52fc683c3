"""A recorded flight played on a clock: speed, pause, seek, and what a ground link reads meanwhile."""

from __future__ import annotations

from pathlib import Path

import pytest
from replayed import later_part, record_flight

from avionics.messages import Command, CommandKind
from groundstation.command.replay_link import keys_in, steer
from logs.reader import open_log
from logs.replay.player import OBEYS_NOBODY, Player
from logs.replay.recorded_flight import RecordedFlight, recorded_flight


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return record_flight(tmp_path_factory.mktemp("flown") / "flight.mcap")


@pytest.fixture(scope="module")
def flight(recording: Path) -> RecordedFlight:
    with open_log(recording) as log:
        return recorded_flight(log)


def played(player: Player, until: float, dt: float = 0.02, since: float = 100.0) -> float:
    """Advance the clock from ``since`` to ``until`` seconds later; what it shows then."""
    steps = round(until / dt)
    for i in range(steps + 1):
        player.advance(since + i * dt)
    return since + steps * dt


@pytest.mark.parametrize("speed", [pytest.param(0.5, marks=pytest.mark.validate), 1.0, 3.0])
def test_it_plays_at_its_speed(flight: RecordedFlight, speed: float) -> None:
    player = Player(flight, speed)
    played(player, 2.0)
    assert player.time == pytest.approx(2.0 * speed, abs=0.011)
    assert player.view.time_us == round(player.time * 1e6)


def test_a_pause_takes_no_time_of_the_flight(flight: RecordedFlight) -> None:
    player = Player(flight)
    now = played(player, 1.0)
    assert steer(player, " ") and player.paused
    now = played(player, 5.0, since=now)
    assert player.time == pytest.approx(1.0, abs=0.011)
    assert steer(player, " ") and not player.paused
    played(player, 1.0, since=now)
    assert player.time == pytest.approx(2.0, abs=0.011)


def test_seek_gives_the_memory_that_the_flight_had_there(flight: RecordedFlight) -> None:
    """Forwards by a snapshot, and back from there to before the first one."""
    jumped = Player(flight)
    for time in (12.5, 3.0):
        jumped.seek(time)
        straight = Player(flight)
        played(straight, time, dt=0.005)
        assert jumped.time == straight.time == pytest.approx(time, abs=0.006)
        assert jumped.view.autopilot.snapshot() == straight.view.autopilot.snapshot()


def test_a_later_file_is_played_from_its_first_snapshot_on(
    flight: RecordedFlight, tmp_path: Path, recording: Path
) -> None:
    with open_log(later_part(recording, tmp_path / "a-2.mcap", 12)) as log:
        later = Player(recorded_flight(log))
    first = flight.snapshots[1].time_us * 1e-6
    assert later.time == first == later.view.time_us * 1e-6
    played(later, 1.0)
    straight = Player(flight)
    straight.seek(later.time + 1e-4)
    assert later.time == pytest.approx(first + 1.0, abs=0.011)
    assert later.view.autopilot.snapshot() == straight.view.autopilot.snapshot()
    later.seek(0.0)
    assert later.time == first


def test_keys_jump_within_the_flight_and_end_it(flight: RecordedFlight) -> None:
    player = Player(flight)
    assert steer(player, "\x1b[C") and player.time == pytest.approx(10.0, abs=0.006)
    assert steer(player, "\x1b[D") and player.time == pytest.approx(0.0, abs=0.006)
    for _ in range(3):
        steer(player, "\x1b[C")
    assert player.over and player.time == player.end
    assert not steer(player, "q")
    assert steer(player, "?")


def test_who_cannot_keep_up_plays_slower_and_returns(flight: RecordedFlight) -> None:
    player = Player(flight, speed=1e6)
    player.advance(0.0)
    player.advance(1.0)
    assert 1.0 < player.time < 3.0 and not player.over


def test_it_obeys_nobody(flight: RecordedFlight) -> None:
    player = Player(flight)
    assert player.view.refusal(Command(0, CommandKind.ARM)) == OBEYS_NOBODY


def test_keys_that_come_at_once_are_all_of_them_keys() -> None:
    assert keys_in("\x1b[C\x1b[C q") == ["\x1b[C", "\x1b[C", " ", "q"]
    assert keys_in("\x1b[1;5C\x1b[3~x") == ["\x1b[1;5C", "\x1b[3~", "x"]
    assert keys_in("\x1b") == ["\x1b"] and keys_in("") == []
