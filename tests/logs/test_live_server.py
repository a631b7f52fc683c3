"""Serving a recording while it grows: what a viewer that hangs does to others, and where it is asked for."""

from __future__ import annotations

import base64
import re
import socket
from pathlib import Path

import pytest
from recorded import EPOCH_NS, flight

from avionics import topics
from logs.live.server import LiveServer, parse_address
from logs.reader import open_log
from logs.recorder import McapRecorder
from wingbeat.errors import InputError


def stuck_viewer(port: int) -> socket.socket:
    """Subscribes to ADC bursts, and never reads again."""
    viewer = socket.create_connection(("127.0.0.1", port))
    key = base64.b64encode(bytes(16)).decode()
    lines = ("GET / HTTP/1.1", "Host: x", "Upgrade: websocket", "Connection: Upgrade", f"Sec-WebSocket-Key: {key}")
    lines += ("Sec-WebSocket-Version: 13", "Sec-WebSocket-Protocol: foxglove.sdk.v1")
    viewer.sendall("\r\n".join((*lines, "", "")).encode())
    heard = b""
    while not (found := re.search(rb'"id":(\d+),"topic":"/sensors/adc"', heard)):
        heard += viewer.recv(65536)
    text = f'{{"op":"subscribe","subscriptions":[{{"id":1,"channelId":{found[1].decode()}}}]}}'.encode()
    viewer.sendall(bytes([0x81, 0x80 | len(text), 0, 0, 0, 0]) + text)
    return viewer


def test_a_viewer_that_takes_nothing_holds_up_nobody(tmp_path: Path) -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install foxglove-sdk")
    path, (_, burst) = tmp_path / "a.mcap", flight(0.02, (topics.ADC,))[0]
    with LiveServer(parse_address("127.0.0.1:0"), [path]) as server:
        viewer = stuck_viewer(int(server.url.rpartition(":")[2]))
        with McapRecorder(path, start_epoch_ns=EPOCH_NS) as recorder:
            for tick in range(1, 20_001):
                recorder.record(topics.ADC, burst._replace(time_us=tick * 10_000))
    viewer.close()
    assert server.finished and not server.failure and not recorder.dropped
    with open_log(path) as log:
        assert log.complete and log.topics[topics.ADC.name].messages == 20_000


def test_whatever_a_live_view_raises_ends_it_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed: pip install foxglove-sdk")

    def broken(*args: object, **options: object) -> None:
        raise KeyError("no such channel")

    monkeypatch.setattr(LiveServer, "_show", broken)
    with LiveServer(parse_address("127.0.0.1:0"), [tmp_path / "a.mcap"]) as server:
        server._thread.join(10.0)
        assert server.failure == "'no such channel'"
    assert "Traceback" not in capfd.readouterr().err


def test_an_address_has_a_host_and_a_port() -> None:
    assert parse_address("0.0.0.0:8765") == ("0.0.0.0", 8765) and parse_address("[::1]:0") == ("::1", 0)
    for text in ("8765", "host", ":1", "host:", "host:-1", "host:65536", "host:x"):
        with pytest.raises(InputError, match="HOST:PORT"):
            parse_address(text)
