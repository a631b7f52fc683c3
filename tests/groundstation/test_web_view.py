"""The web view without a browser: page, WebSocket protocol, commands, isolation."""

from __future__ import annotations

import contextlib
import http.client
import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

import pytest
from flight_computer import aboard
from lossy_vehicle import LossyVehicle, VibratingVehicle, on_the_air
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from avionics.link.dialect import mavlink
from avionics.link.vehicle import Home
from groundstation.command.main import main
from groundstation.link.connection import Connection
from groundstation.link.missions import Item
from groundstation.link.station import Note, Picture, Station
from groundstation.link.vehicle_state import StatusLine, VehicleState
from groundstation.web.feed import COLUMNS, SAMPLES, Cursor, Feed
from groundstation.web.server import SOCKET, WebServer
from groundstation.web.view import page, serve_station
from wingbeat.message import Severity

PATIENCE = 30.0


class Flying(LossyVehicle):
    """Sends an attitude with every answer; each is 1 s later than the one before."""

    def answers(self, message: object) -> list[object]:
        answered = super().answers(message)
        return [*answered, mavlink.MAVLink_attitude_message(1000 * len(self.requests), 0.2, 0.1, 1.0, 0, 0, 0)]


class Ended(BaseException):
    """Raised in the loop of the view to end it, as Ctrl-C does."""


class Served(NamedTuple):
    """A station with its web view."""

    vehicle: LossyVehicle | None
    server: WebServer
    feed: Feed
    station: Station
    failures: list[str]


@contextlib.contextmanager
def served(vehicle: LossyVehicle | str, feed: Feed | None = None) -> Iterator[Served]:
    """A web view of a scripted vehicle, or one with a URL, whose link runs in a thread as in the command."""
    feed = feed or Feed()
    over = threading.Event()
    failures: list[str] = []

    def pause(seconds: float) -> None:
        if over.wait(seconds):
            raise Ended

    air = contextlib.nullcontext(vehicle) if isinstance(vehicle, str) else on_the_air(vehicle)
    with air as url, WebServer(page(), feed, 0) as server:
        connection = Connection(url, stays=True, pause=pause)
        station = Station(connection)

        def run() -> None:
            with contextlib.suppress(Ended):
                serve_station(station, feed, server, failures.append)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield Served(None if isinstance(vehicle, str) else vehicle, server, feed, station, failures)
        finally:
            over.set()
            thread.join(PATIENCE)
            connection.close()
            assert not thread.is_alive()


@contextlib.contextmanager
def viewer(server: WebServer, origin: str = "") -> Iterator[ClientConnection]:
    parts = urlsplit(server.url)
    known = Origin(origin or f"http://{parts.netloc}")
    with connect(f"ws://{parts.netloc}{SOCKET}", origin=known, max_size=None) as link:
        yield link


def until(link: ClientConnection, true: Callable[[dict[str, Any]], bool]) -> list[dict[str, Any]]:
    """The messages up to the first that fulfills a condition."""
    limit, found = time.monotonic() + PATIENCE, []
    while time.monotonic() < limit:
        found.append(json.loads(link.recv(PATIENCE)))
        if true(found[-1]):
            return found
    raise AssertionError(f"never came true; last: {found[-1]}")


def order(server: WebServer, link: ClientConnection, command: str, argument: str = "", token: str = "") -> None:
    link.send(json.dumps({"token": token or server.token, "command": command, "argument": argument}))


def notes(messages: list[dict[str, Any]]) -> list[str]:
    return [note["text"] for message in messages for note in message["notes"]]


def get(server: WebServer, path: str, **headers: str) -> http.client.HTTPResponse:
    parts = urlsplit(server.url)
    client = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=PATIENCE)
    client.request("GET", path, headers=headers)
    return client.getresponse()


# --- page ---------------------------------------------------------------------------------------------------------


def test_page_is_served_on_the_loopback_without_the_token() -> None:
    """GIVEN a server WHEN its page is requested THEN it comes with its safety headers, without the token; a foreign
    host name and another path are refused.
    """
    with WebServer(page(), Feed(), 0) as server:
        assert server.url.startswith("http://127.0.0.1:")
        answer = get(server, "/")
        text = answer.read().decode()
        assert answer.status == 200 and "Wingbeat ground view" in text and server.token not in text
        assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
        assert "connect-src 'self'" in text and "http://" not in text.replace("http://www.w3.org", "")
        assert get(server, "/other").status == 404
        assert get(server, "/", Host="attacker.example:80").status == 403


def test_port_in_use_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.chdir(tmp_path)
    with WebServer(page(), Feed(), 0) as server, on_the_air(LossyVehicle()) as url:
        port = str(urlsplit(server.url).port)
        assert main(["gcs", url, "--no-record", "web", "--port", port]) == 2
        assert main(["gcs", url, "--no-record", "web", "--port", "70000"]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert "use --port" in first and "not a port" in second


def test_command_prints_its_address_serves_and_ends_on_ctrl_c(tmp_path: Path) -> None:
    """GIVEN the command WHEN its page and data were read and Ctrl-C comes THEN it ends with 130 and has recorded."""
    words = [sys.executable, "-m", "groundstation.command.main", "gcs"]
    options = ["--json", "--record-to", "kept", "web", "--port", "0"]
    root = Path(__file__).parents[2]
    with on_the_air(Flying()) as url:
        process = subprocess.Popen(
            [*words, url, *options], cwd=tmp_path, stdout=subprocess.PIPE, text=True,
            env=os.environ | {"PYTHONPATH": str(root)},
        )  # fmt: skip
        try:
            assert process.stdout is not None
            parts = urlsplit(json.loads(process.stdout.readline())["url"])
            with connect(f"ws://{parts.netloc}{SOCKET}", origin=Origin(f"http://{parts.netloc}")) as link:
                until(link, lambda message: message["name"] != "")
            process.send_signal(signal.SIGINT)
            assert process.wait(PATIENCE) == 130
        finally:
            process.kill()
            process.wait()
    assert list((tmp_path / "kept").glob("*.mcap"))


# --- protocol -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("origin", ["http://attacker.example", "http://127.0.0.1:1", "null"])
def test_pages_of_other_origins_are_refused(origin: str) -> None:
    with WebServer(page(), Feed(), 0) as server, pytest.raises(InvalidStatus) as refused, viewer(server, origin):
        pass
    assert refused.value.response.status_code == 403


def test_two_browsers_get_the_state_and_a_fallen_one_does_not_disturb() -> None:
    """GIVEN a browser WHEN another never reads and a third goes away without a farewell THEN it gets new data."""
    with served(Flying()) as view, viewer(view.server), viewer(view.server) as link:
        with viewer(view.server) as other:
            until(other, lambda message: message["roll"] is not None)
            other.socket.close()
        first = until(link, lambda message: message["roll"] is not None and message["mode"])
        assert first[-1]["name"] == "flapping wing 1" and first[-1]["armed"] is False
        assert first[-1]["roll"] == pytest.approx(0.2) and first[-1]["link"]["lost"] is False
        until(link, lambda message: bool(message["samples"]))
        assert not view.failures


def test_a_failure_of_the_feed_is_reported_and_the_link_continues(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN data that cannot be sent to one browser THEN its connection ends, it is reported, the next one works."""
    feed = Feed()
    message, calls = feed.message, []

    def failing(cursor: Cursor) -> tuple[str, Cursor]:
        calls.append(cursor)
        if len(calls) == 1:
            raise ValueError("unsuitable")
        return message(cursor)

    monkeypatch.setattr(feed, "message", failing)
    with served(Flying(), feed) as view:
        with viewer(view.server) as link, contextlib.suppress(Exception):
            link.recv(PATIENCE)
        with viewer(view.server) as link:
            until(link, lambda message: message["roll"] is not None)
        deadline = time.monotonic() + PATIENCE  # the failure is taken by the thread of the station
        while not view.failures and time.monotonic() < deadline:
            time.sleep(0.02)
        assert len(view.failures) == 1 and "ValueError: unsuitable" in view.failures[0]


# --- commands -----------------------------------------------------------------------------------------------------


def test_commands_reach_the_vehicle_and_their_results_the_browser() -> None:
    """GIVEN the token WHEN arm, a mode and an unknown mode are commanded THEN the first two are executed, and all
    three results are notices.
    """
    with served(Flying()) as view, viewer(view.server) as link:
        until(link, lambda message: message["name"] != "")
        order(view.server, link, "arm")
        assert "armed" in notes(until(link, lambda message: message["armed"] is True and bool(notes([message]))))
        order(view.server, link, "mode", "ALTITUDE_HOLD")
        until(link, lambda message: message["mode"] == "ALTITUDE_HOLD")
        order(view.server, link, "mode", "HOVER")
        found = until(link, lambda message: any(note["failed"] for note in message["notes"]))
        assert any("no mode 'HOVER'" in text for text in notes(found))
        order(view.server, link, "disarm")
        until(link, lambda message: message["armed"] is False)


def test_flight_computer_obeys_and_denies(tmp_path: Path) -> None:
    """GIVEN a flight computer on a bench without GPS WHEN a browser changes the mode and arms THEN the mode changes,
    and the denial of arming has its reason.
    """
    with aboard(tmp_path / "kept.json") as url, served(url) as view, viewer(view.server) as link:
        until(link, lambda message: message["name"] != "" and "STABILIZED" in message["modes"])
        order(view.server, link, "mode", "STABILIZED")
        until(link, lambda message: message["mode"] == "STABILIZED")
        order(view.server, link, "arm")
        found = until(link, lambda message: any(note["failed"] for note in message["notes"]))
        assert any(text.startswith("COMPONENT_ARM_DISARM denied: ") for text in notes(found)), notes(found)
        assert found[-1]["armed"] is False


def test_a_denial_is_a_notice_with_its_reason() -> None:
    vehicle = Flying()
    vehicle.results[400] = mavlink.MAV_RESULT_DENIED
    vehicle.reports = ["arming denied: battery 3 %, minimum 30 %"]
    with served(vehicle) as view, viewer(view.server) as link:
        until(link, lambda message: message["name"] != "")
        order(view.server, link, "arm")
        found = until(link, lambda message: any(note["failed"] for note in message["notes"]))
        assert "COMPONENT_ARM_DISARM denied: arming denied: battery 3 %, minimum 30 %" in notes(found)
        assert not vehicle.armed


def test_commands_without_the_token_and_malformed_messages_are_ignored() -> None:
    """GIVEN messages without the token or form WHEN a valid command follows THEN only this one is executed."""
    with served(Flying()) as view, viewer(view.server) as link:
        until(link, lambda message: message["name"] != "")
        order(view.server, link, "arm", token="0" * 22)
        for text in ("", "arm", "[]", "null", '{"command": "arm"}', '{"token": 5, "command": "arm"}', b"\xff"):
            link.send(text)
        order(view.server, link, "unknown")
        order(view.server, link, "mode", "ALTITUDE_HOLD")
        until(link, lambda message: message["mode"] == "ALTITUDE_HOLD")
        assert view.vehicle is not None and not view.vehicle.armed and not view.failures


def test_a_command_without_a_vehicle_is_a_notice() -> None:
    """GIVEN no vehicle on the link WHEN it is commanded to arm THEN the notice has the reason."""
    vehicle = Flying()
    vehicle.heartbeat = lambda: mavlink.MAVLink_system_time_message(0, 0)  # type: ignore[method-assign]
    with served(vehicle) as view, viewer(view.server) as link:
        order(view.server, link, "arm")
        found = until(link, lambda message: bool(message["notes"]))
        assert notes(found) == ["arm: no vehicle on the link"] and found[-1]["name"] == ""


def test_spectrum_has_the_amplitudes_of_a_vibrating_vehicle(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN sine waves on two axes WHEN a browser wants the spectrum THEN both peaks have their frequency and
    amplitude, and the messages are stopped when no browser asks again.
    """
    monkeypatch.setattr("groundstation.web.spectrum.LEASE", 2.0)
    vehicle = VibratingVehicle()
    with served(vehicle) as view, viewer(view.server) as link:
        until(link, lambda message: message["name"] != "")
        assert not vehicle.intervals
        order(view.server, link, "spectrum")
        found = until(link, lambda message: bool(message.get("spectrum")))[-1]["spectrum"]
        assert found["rate"] == pytest.approx(100.0)
        for axis, frequency, amplitude in (("z", 4.0, 2.0), ("x", 25.0, 0.5)):
            peak = max(range(len(found["frequency"])), key=found["amplitude"][axis].__getitem__)
            assert found["frequency"][peak] == pytest.approx(frequency, abs=0.6)
            # A Hann window loses at most 1.4 dB between two lines.
            assert 0.84 * amplitude < found["amplitude"][axis][peak] < 1.01 * amplitude
            assert found["rms"][axis] == pytest.approx(amplitude / math.sqrt(2.0), rel=0.05)
        assert max(found["amplitude"]["y"]) == 0.0
        until(link, lambda message: "spectrum" in message and message["spectrum"] is None)
        assert vehicle.intervals == [10_000.0, 0.0] and not view.failures


def test_a_vehicle_without_the_message_is_a_notice() -> None:
    vehicle = Flying()
    vehicle.results[mavlink.MAV_CMD_SET_MESSAGE_INTERVAL] = mavlink.MAV_RESULT_DENIED
    with served(vehicle) as view, viewer(view.server) as link:
        until(link, lambda message: message["name"] != "")
        order(view.server, link, "spectrum")
        found = until(link, lambda message: any(note["failed"] for note in message["notes"]))
        assert any(text.startswith("vibration: SET_MESSAGE_INTERVAL denied") for text in notes(found))


# --- data ---------------------------------------------------------------------------------------------------------


def at(seconds: float, **fields: Any) -> Picture:
    return Picture(state=VehicleState(system=1, time=seconds, received_at=seconds, **fields))


def read(feed: Feed, cursor: Cursor) -> tuple[dict[str, Any], Cursor]:
    text, cursor = feed.message(cursor)
    return json.loads(text), cursor


def test_each_browser_gets_every_sample_and_text_once() -> None:
    """GIVEN samples and texts WHEN a browser asks twice THEN the second message has only the new ones."""
    feed = Feed()
    line = StatusLine(1.0, Severity.WARNING, "wind is strong")
    for n in range(3):
        feed.update(at(n, altitude=10.0 + n, events=(line,), text_count=1)._replace(notes=(Note(1.0, "armed"),)))
    feed.update(
        at(2.1, altitude=99.0, events=(line,), text_count=1)._replace(notes=(Note(1.0, "armed"),), note_count=1)
    )
    first, cursor = read(feed, Cursor())
    column = COLUMNS.index("altitude")
    assert first["restart"] and [row[column] for row in first["samples"]] == [10.0, 11.0, 12.0]
    assert [one["text"] for one in first["events"]] == ["wind is strong"] and len(first["notes"]) == 1
    feed.update(at(3.0, altitude=math.nan, text_count=1)._replace(note_count=1))
    second, cursor = read(feed, cursor)
    assert not second["restart"] and [row[column] for row in second["samples"]] == [None]
    assert second["events"] == second["notes"] == [] and "mission" not in second
    feed.update(at(0.5))
    third, _ = read(feed, cursor)
    assert third["restart"] and len(third["samples"]) == 1


def test_global_positions_become_meters_from_home() -> None:
    home = Home(math.radians(48.0), math.radians(11.0), 500.0)
    feed = Feed()
    feed.update(at(1.0, home=home, latitude=math.radians(48.001), longitude=math.radians(11.0)))
    message, _ = read(feed, Cursor())
    assert message["north"] == message["samples"][0][COLUMNS.index("north")] == pytest.approx(111.3, abs=0.1)


def test_samples_are_bounded() -> None:
    feed = Feed()
    for n in range(2 * SAMPLES):
        feed.update(at(float(n)))
    assert SAMPLES <= len(read(feed, Cursor())[0]["samples"]) <= 1.1 * SAMPLES


def test_mission_has_places_in_meters_and_hostile_text_is_escaped() -> None:
    """GIVEN a global and a local item, and a notice with control characters THEN both have places in m from home, and
    no control character remains.
    """
    home = Home(math.radians(48.0), math.radians(11.0), 500.0)
    none = (0.0, 0.0, 0.0, 0.0)
    items = (Item(3, 16, none, 480_010_000, 110_000_000, 40.0), Item(1, 16, none, 300_000, -50_000, -20.0))
    feed = Feed()
    feed.update(at(1.0, home=home)._replace(mission=items, notes=(Note(1.0, "a\x1b[2Jb\u202ec"),), note_count=1))
    message, _ = read(feed, Cursor())
    assert message["mission"][0]["north"] == pytest.approx(111.3, abs=0.1)
    assert message["mission"][0]["east"] == pytest.approx(0.0, abs=1e-6)
    assert (message["mission"][1]["north"], message["mission"][1]["east"]) == (30.0, -5.0)
    assert message["mission"][1]["altitude"] == "20 m"
    assert "\x1b" not in message["notes"][0]["text"] and "\u202e" not in message["notes"][0]["text"]
