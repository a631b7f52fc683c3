"""A recording whose process is killed: at most half a second of flight or of wall time is not in the file."""

from __future__ import annotations

import os
import random
import select
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from recording_child import TOLD

from avionics import topics
from groundstation.command.recordings import put_right
from groundstation.link.connection import Connection, listen_locally
from logs.join import join
from logs.reader import Log, open_log
from logs.recover import recover

CHILD = Path(__file__).with_name("recording_child.py")
MOST_LOST = 0.5
"""s; of flight or wall time"""
PATIENCE = 60.0
"""s; for a process to begin"""


class Pace(NamedTuple):
    """What is recorded, and how fast."""

    rate: str
    """Hz of one topic, or all of a flight's"""
    speed: float
    """-; flight time per wall time"""


PACES = (
    Pace("1", 1.0),
    Pace("5", 1.0),
    Pace("200", 1.0),
    Pace("all", 1.0),
    Pace("all", 0.1),
    Pace("all", 10.0),
    Pace("200", float("inf")),
    Pace("all", float("inf")),
)


class Killed(NamedTuple):
    """What a process had recorded when it was killed."""

    channel: NDArray[np.int64]
    """(N,)"""
    time_us: NDArray[np.int64]
    """us since boot; (N,)"""
    wall: NDArray[np.float64]
    """s; (N,), wall clock when the message had been recorded"""
    at: float
    """s; wall clock when it was killed"""


def killed(path: Path, pace: Pace, after: float) -> Killed:
    """Record to ``path``, and kill ``after`` s of wall time behind the first message."""
    command = [sys.executable, str(CHILD), str(path), pace.rate, str(pace.speed)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        stated = _read(child.stdout, PATIENCE, TOLD.size)
        stated += _read(child.stdout, after)
        at = time.monotonic()
        child.kill()
        stated += child.stdout.read()
    whole = len(stated) // TOLD.size * TOLD.size
    table = np.frombuffer(stated[:whole], np.dtype([("channel", "<u2"), ("time_us", "<i8"), ("wall", "<f8")]))
    return Killed(table["channel"].astype(np.int64), table["time_us"], table["wall"], at)


def _read(pipe: IO[bytes], seconds: float, enough: int = sys.maxsize) -> bytes:
    """What comes within so many seconds, or until it is enough."""
    end, parts = time.monotonic() + seconds, bytearray()
    while len(parts) < enough and (left := end - time.monotonic()) > 0.0:
        if select.select([pipe], [], [], left)[0]:
            part = os.read(pipe.fileno(), 1 << 20)
            assert part, "the recording ended by itself"
            parts += part
    return bytes(parts)


def in_file(log: Log) -> set[tuple[int, int]]:
    """Channel and time (us since boot) of every message."""
    tables = log.tables([name for name, info in log.topics.items() if info.layout is not None])
    return {(log.topics[name].channel, time) for name, table in tables.items() for time in table["time_us"].tolist()}


def lost(path: Path, stated: Killed) -> tuple[float, float]:
    """Flight time and wall time (s) from the first message that is not in the file to the end; 0 for none."""
    with open_log(path) as log:
        *torn, cut_off = log.damage
        assert cut_off == "the file was cut off before its end" and log.verify() == list(log.damage)
        # The kill may fall into a write.
        size = path.stat().st_size
        assert not torn or (len(torn) == 1 and torn[0].endswith(f" to {size} cannot be read")), torn
        found = in_file(log)
        if topics.RECORDER.name in log.topics:
            assert not log.columns(topics.RECORDER)["dropped"].any()
    pairs = zip(stated.channel.tolist(), stated.time_us.tolist(), strict=True)
    missing = np.array([pair not in found for pair in pairs])
    if not missing.any():
        return 0.0, 0.0
    first = int(np.argmax(missing))
    return float(stated.time_us[-1] - stated.time_us[first]) * 1e-6, stated.at - float(stated.wall[first])


def check(path: Path, pace: Pace, after: float) -> None:
    """Kill, and see what is lost; a flight at the pace of the clock is measured by the clock."""
    in_flight, in_time = lost(path, killed(path, pace, after))
    loss = min(in_flight, in_time) if pace.speed > 1.0 else in_time
    assert loss <= MOST_LOST, f"{pace}, killed after {after:.3f} s: {in_flight:.3f} s of flight, {in_time:.3f} s"
    before = recover(path).messages
    with open_log(path) as log:
        assert log.complete and log.verify() == []
        assert sum(info.messages for info in log.topics.values()) == before


@pytest.mark.parametrize(
    ("pace", "after"), [(PACES[0], 0.85), (PACES[2], 0.4), (PACES[3], 0.6), (PACES[-1], 0.3)], ids=str
)
def test_a_killed_recording_lacks_half_a_second_at_most(tmp_path: Path, pace: Pace, after: float) -> None:
    check(tmp_path / "a.mcap", pace, after)


@pytest.mark.validate
@pytest.mark.parametrize("pace", PACES, ids=str)
def test_killed_at_twenty_random_moments(tmp_path: Path, pace: Pace) -> None:
    source = random.Random(f"{pace}")
    for number in range(20):
        check(tmp_path / f"{number}.mcap", pace, source.uniform(0.05, 1.5))


# --- a flight ---------------------------------------------------------------------------------------------


class Received(NamedTuple):
    """What telemetry said of the time of the flight."""

    wall: list[float]
    """s; wall clock"""
    time: list[float]
    """s; since boot, as last heard then"""

    def surely_recorded(self, at: float) -> float:
        """Flight time (s since boot) before which nothing may be missing from a flight killed at ``at``."""
        earlier = int(np.searchsorted(self.wall, at - MOST_LOST, side="right")) - 1
        return min(self.time[-1] - MOST_LOST, self.time[earlier])


def listened(connection: Connection, seconds: float) -> Received:
    """Listen to a flight for so long from its first message on."""
    heard, end = Received([], []), time.monotonic() + PATIENCE
    while (now := time.monotonic()) < end:
        connection.listen(0.01)
        if connection.state.time is not None:
            end = end if heard.time else now + seconds
            heard.wall.append(now)
            heard.time.append(connection.state.time)
    assert heard.time, "the flight did not begin"
    return heard


def family(process: int) -> list[int]:
    """A process and all that it started."""
    listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
    parents = {int(pid): int(parent) for pid, parent in (line.split() for line in listed.splitlines())}
    found = [process]
    for one in found:
        found += [pid for pid, parent in parents.items() if parent == one]
    return found


def killed_flight(folder: Path, speed: str, seconds: float) -> float:
    """Fly in ``folder``, kill every process; return the time (s since boot) before which nothing may be missing."""
    connection = listen_locally()
    command = [sys.executable, "-m", "groundstation.command.main", "fly", "--speed", speed, "--json"]
    command += ["--gcs", connection.url.replace("udpin", "udpout")]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL) as flying:
        try:
            heard = listened(connection, seconds)
        finally:
            at = time.monotonic()
            for process in reversed(family(flying.pid)):
                os.kill(process, signal.SIGKILL)
            connection.close()
    return heard.surely_recorded(at)


def check_recording(log: Log, until: float) -> None:
    """Every topic that comes regularly has come without a pause until then."""
    # Run times, which are not deterministic, come once a second, five at a time.
    known = {name: info for name, info in log.topics.items() if info.rate and info.layout is not None}
    regular = [name for name, info in known.items() if info.deterministic]
    assert regular and until > 1.0
    for name, columns in log.tables(regular).items():
        period = 1.0 / (log.topics[name].rate or 1.0)
        assert columns.time[-1] >= until - period, f"{name} ends at {columns.time[-1]} s, not {until:.3f} s"
        assert np.diff(columns.time).max(initial=0.0) < 1.5 * period, f"a pause in {name}"


@pytest.mark.validate
@pytest.mark.parametrize(("speed", "seconds"), [("max", 3.0), ("1", 6.0)])
def test_a_killed_flight_lacks_half_a_second_at_most(
    tmp_path: Path, speed: str, seconds: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """GIVEN a flight whose processes are all killed THEN its files open, the next start repairs them, they join."""
    until = killed_flight(tmp_path, speed, seconds)
    parts = sorted((tmp_path / "recordings").glob("*.mcap"))
    assert [part.suffixes[-2] for part in parts] == [".avionics", ".world"]
    for part in parts:
        with open_log(part) as log:
            assert not log.complete
            check_recording(log, until)
    put_right(tmp_path / "recordings")
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and all("repaired truncated recording" in line for line in said)
    assert join(parts, tmp_path / "flight.mcap") == []
    with open_log(tmp_path / "flight.mcap") as log:
        assert log.complete and log.verify() == []
        check_recording(log, until)
