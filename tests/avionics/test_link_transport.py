"""Addresses and ports: what is refused, and that bytes arrive."""

from __future__ import annotations

import multiprocessing
import os
import socket
import sys
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from link_station import PATIENCE
from link_vehicle import FakeVehicle
from ports import free_port

from avionics.link import dialect, transport
from avionics.link.channel import PORTION
from avionics.link.codec import FrameWriter
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.transport import (
    CREDIT,
    GONE,
    HALF_OPEN,
    MOST_PEERS,
    RENEWED,
    Listener,
    Packet,
    SocketStream,
    Transport,
    open_stream,
    open_transport,
)
from avionics.link.urls import FORMS, LinkUrl, parse_url
from wingbeat.errors import InputError


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpin:0.0.0.0:14550", LinkUrl("udpin", "0.0.0.0", 14550)),
        ("udpout:127.0.0.1:14550", LinkUrl("udpout", "127.0.0.1", 14550)),
        ("tcp:world.local:4560", LinkUrl("tcp", "world.local", 4560)),
        ("tcpin:[::1]:5760", LinkUrl("tcpin", "::1", 5760)),
        ("serial:/dev/ttyUSB0,57600", LinkUrl("serial", "/dev/ttyUSB0", 57600)),
        ("serial:COM3,115200", LinkUrl("serial", "COM3", 115200)),
    ],
)
def test_an_address_is_taken_apart_and_written_again(text: str, url: LinkUrl) -> None:
    assert parse_url(text) == url
    assert str(url) == text


@pytest.mark.parametrize(
    "text",
    ["", "14550", "udp:1.2.3.4:1", "udpin:14550", "udpin::14550", "tcp:host", "tcp:host:x", "tcp:host:0",
     "tcp:host:70000", "serial:/dev/ttyUSB0", "serial:,57600", "serial:x,fast", "tcp:host:-1", "tcp:host:²"],
)  # fmt: skip
def test_what_is_no_address_is_refused_in_one_line_that_names_the_forms(text: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_url(text)
    assert FORMS in str(refused.value) and "\n" not in str(refused.value)


@given(st.text())
def test_any_text_is_an_address_or_bad_input(text: str) -> None:
    try:
        url = parse_url(text)
    except InputError:
        return
    assert parse_url(str(url)) == url


@pytest.mark.parametrize(("kind", "socket_kind"), [("udpin", socket.SOCK_DGRAM), ("tcpin", socket.SOCK_STREAM)])
def test_a_port_in_use_is_named_and_no_other_link_stays_open(kind: str, socket_kind: socket.SocketKind) -> None:
    other = free_port()
    with socket.socket(socket.AF_INET, socket_kind) as taken:
        taken.bind(("127.0.0.1", 0))
        if socket_kind is socket.SOCK_STREAM:
            taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} of 127.0.0.1") as refused:
            GroundLink([f"udpin:127.0.0.1:{other}", f"{kind}:127.0.0.1:{port}"], FakeVehicle())
        assert "\n" not in str(refused.value)
    open_transport(f"udpin:127.0.0.1:{other}").close()


def test_unix_socket_is_for_lockstep_partner_only() -> None:
    assert str(parse_url("unix:name", lockstep=True)) == "unix:name"
    with pytest.raises(InputError, match="is not one of"):
        parse_url("unix:name")
    with pytest.raises(InputError, match="unix:NAME"):
        parse_url("nowhere", lockstep=True)


@pytest.mark.skipif(sys.platform != "linux", reason="abstract Unix sockets")
def test_unix_address_in_use_is_refused() -> None:
    listener = Listener(f"unix:wingbeat-{os.getpid()}")
    with pytest.raises(InputError, match="cannot listen: "):
        Listener(f"unix:wingbeat-{os.getpid()}")
    listener.close()


def test_missing_hosts_and_devices_are_bad_input() -> None:
    for url in ("udpout:no-such-host.invalid:14550", "serial:/dev/no-such-device,57600"):
        with pytest.raises(InputError):
            open_transport(url)
    with pytest.raises(InputError, match="lockstep"):
        open_stream("udpin:127.0.0.1:14550", 0.1)


def _receive(transport: Transport, now: float = 0.0) -> list[Packet]:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        packets = transport.receive(now)
        if packets:
            return packets
        now += 0.01
    raise AssertionError("nothing arrived")


@pytest.mark.parametrize(("ear", "mouth", "kind"), [
    ("udpin", "udpout", socket.SOCK_DGRAM),
    ("tcpin", "tcp", socket.SOCK_STREAM),
])  # fmt: skip
def test_bytes_go_both_ways(ear: str, mouth: str, kind: socket.SocketKind) -> None:
    port = free_port(kind)
    server, client = open_transport(f"{ear}:127.0.0.1:{port}"), open_transport(f"{mouth}:127.0.0.1:{port}")
    deadline, heard = time.monotonic() + PATIENCE, []
    while not heard and time.monotonic() < deadline:
        client.receive(time.monotonic())
        client.send(b"up")
        heard = server.receive(0.0)
    assert heard[0].data.startswith(b"up")
    server.send(b"nobody is welcome yet" if ear == "udpin" else b"")
    server.register_peer(heard[0].peer)
    server.send(b"down")
    assert _receive(client)[0].data == b"down"
    client.close()
    server.close()


def test_a_station_that_left_a_udp_port_is_sent_nothing_more_and_the_last_one_always_is() -> None:
    port = free_port(socket.SOCK_DGRAM)
    server = open_transport(f"udpin:127.0.0.1:{port}")
    server.receive(0.0)
    server.register_peer("left")
    server.receive(10.0)
    server.register_peer("stays")
    server.receive(GONE)
    assert server.peers == ("left", "stays")
    server.receive(GONE + 1.0)
    assert server.peers == ("stays",)
    server.receive(10.0 * GONE)
    assert server.peers == ("stays",), "who hears us may be one whose own words are lost"
    server.register_peer("left")
    assert set(server.peers or ()) == {"left", "stays"}
    server.receive(10.0 * GONE + 0.1)
    assert server.peers == ("left",)
    server.close()


def test_a_tcp_client_comes_back_after_its_station_restarts() -> None:
    port = free_port(socket.SOCK_STREAM)
    client = open_transport(f"tcp:127.0.0.1:{port}")
    now = 0.0
    for _ in range(2):
        station = open_transport(f"tcpin:127.0.0.1:{port}")
        deadline, heard = time.monotonic() + PATIENCE, []
        while not heard and time.monotonic() < deadline:
            now += 0.1
            client.receive(now)
            client.send(b"hello")
            heard = station.receive(0.0)
        assert heard
        station.close()
    client.close()


def test_a_station_that_reads_nothing_costs_frames_and_no_time() -> None:
    port = free_port(socket.SOCK_STREAM)
    server = open_transport(f"tcpin:127.0.0.1:{port}")
    with socket.create_connection(("127.0.0.1", port)) as deaf:
        deaf.sendall(b"x")
        _receive(server)
        began = time.monotonic()
        for _ in range(3000):
            server.send(bytes(10_000))
        assert server.dropped > 0
        assert time.monotonic() - began < PATIENCE
    server.close()


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
def test_a_serial_link_answers_between_noise() -> None:
    master, slave = os.openpty()
    vehicle = FakeVehicle()
    link = GroundLink([f"serial:{os.ttyname(slave)},57600"], vehicle)
    ping = mavlink.MAVLink_ping_message(1, 42, 0, 0)
    os.write(master, b"\xfdnoise\xfe" + FrameWriter(255, 190).pack(ping) + b"\x00\xfd")
    deadline, stock, answers = time.monotonic() + PATIENCE, mavlink.MAVLink(None), []
    stock.robust_parsing = True
    os.set_blocking(master, False)
    while not any(each.get_type() == "PING" for each in answers) and time.monotonic() < deadline:
        link.poll(time.monotonic())
        try:
            answers += stock.parse_buffer(os.read(master, 4096)) or []
        except BlockingIOError:
            continue
    assert [each.seq for each in answers if each.get_type() == "PING"] == [42]
    link.close()
    os.close(master)
    os.close(slave)


def test_a_datagram_of_any_length_is_read_whole_a_portion_at_a_time() -> None:
    """GIVEN a datagram of many frames WHEN it is longer than is looked at at once THEN every frame in it counts."""
    port, voice = free_port(), FrameWriter(255, 190)
    frames = [voice.pack(mavlink.MAVLink_ping_message(1, number, 0, 0)) for number in range(2000)]
    vehicle = FakeVehicle()
    link = GroundLink([f"udpin:127.0.0.1:{port}"], vehicle)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.sendto(b"".join(frames), ("127.0.0.1", port))
        station.sendto(frames[0] + b"\xfd\x20", ("127.0.0.1", port))
        station.sendto(frames[1], ("127.0.0.1", port))
        now = 0.0
        while link.counts[0].frames < 2002 and now < 10.0:
            before = link.counts[0].frames
            link.poll(now)
            now += 0.004
            assert link.counts[0].frames - before <= 2 * PORTION / len(frames[0])
    assert (link.counts[0].frames, link.counts[0].bad_bytes) == (2002, 2)
    link.close()


class Door:
    """A TCP server full of connections, some of which have said something that counts."""

    def __init__(self, stack: ExitStack) -> None:
        self.port, self.stack, self.now = free_port(socket.SOCK_STREAM), stack, 0.0
        self.server = open_transport(f"tcpin:127.0.0.1:{self.port}")
        stack.callback(self.server.close)
        self.disconnected: list[Any] = []

    def enter(self) -> socket.socket:
        """Somebody connects, and is let in if there is room."""
        guest = self.stack.enter_context(socket.create_connection(("127.0.0.1", self.port)))
        self.look()
        return guest

    def look(self) -> list[Packet]:
        packets = self.server.receive(self.now)
        self.disconnected += [packet.peer for packet in packets if not packet.data]
        return packets

    def speak(self, guest: socket.socket) -> bool:
        """A guest says something valid; whether it is heard."""
        guest.sendall(b"word")
        heard = [packet for packet in self.look() if packet.peer == guest.getsockname()]
        for packet in heard:
            self.server.register_peer(packet.peer)
        return bool(heard)


def test_silent_connections_do_not_shut_the_door_and_stations_stay() -> None:
    """GIVEN as many connections as fit, all but one silent WHEN another comes THEN the oldest silent one goes."""
    with ExitStack() as stack:
        door = Door(stack)
        station = door.enter()
        assert door.speak(station)
        silent = [door.enter() for _ in range(MOST_PEERS - 1)]
        assert door.disconnected == []
        late = door.enter()
        assert door.speak(late) and door.speak(station)
        assert door.disconnected == [silent[0].getsockname()]


def test_stations_that_are_heard_are_not_turned_out_and_those_long_gone_are() -> None:
    with ExitStack() as stack:
        door = Door(stack)
        stations = [door.enter() for _ in range(MOST_PEERS)]
        assert all(door.speak(station) for station in stations)
        late = door.enter()
        assert not door.speak(late) and door.disconnected == []
        door.now = HALF_OPEN + 1.0
        assert all(door.speak(station) for station in stations[1:])
        assert door.speak(late) or door.speak(late)
        assert door.disconnected == [stations[0].getsockname()]


def test_peers_that_send_one_heartbeat_do_not_keep_the_next_out() -> None:
    """GIVEN as many TCP peers as fit, silent after one heartbeat THEN one more is answered within a few seconds."""
    port, now = free_port(socket.SOCK_STREAM), 0.0
    link = GroundLink([f"tcpin:127.0.0.1:{port}"], FakeVehicle())
    heartbeat = FrameWriter(255, 190).pack(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    with ExitStack() as stack:
        stack.callback(link.close)
        for number in range(MOST_PEERS):
            peer = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
            peer.sendall(heartbeat)
            while link.counts[0].frames <= number:
                now += 1e-4
                link.poll(now)
        late = stack.enter_context(socket.create_connection(("127.0.0.1", port)))
        late.sendall(heartbeat)
        late.setblocking(False)
        received, end = b"", now + HALF_OPEN + 1.0
        while not received and now < end:
            now += 0.1
            link.poll(now)
            try:
                received = late.recv(4096)
            except BlockingIOError:
                continue
        assert HALF_OPEN <= 5.0 and received


# --- the generated dialect ---------------------------------------------------------------------------------


def _generate(folder: str, results: Any) -> None:
    results.put(str(dialect.generate(Path(folder))))


@pytest.mark.validate
def test_processes_that_start_at_once_all_get_a_sound_module(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    workers = [context.Process(target=_generate, args=(str(tmp_path), results)) for _ in range(3)]
    for worker in workers:
        worker.start()
    paths = {results.get(timeout=60) for _ in workers}
    for worker in workers:
        worker.join()
    assert len(paths) == 1
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == [Path(paths.pop()).name]
    assert {worker.exitcode for worker in workers} == {0}


def test_the_cache_is_made_once_and_used_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WINGBEAT_CACHE", str(tmp_path))
    first = dialect.load_dialect()
    written = Path(first.__file__).stat().st_mtime_ns
    assert tmp_path in Path(first.__file__).parents
    assert Path(dialect.load_dialect().__file__).stat().st_mtime_ns == written


@pytest.mark.parametrize("damage", ["a file in place of the folder", "a torn module"])
def test_an_unusable_cache_does_not_stop_the_link(
    damage: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WINGBEAT_CACHE", str(tmp_path))
    if damage == "a torn module":
        (tmp_path / "dialect").mkdir()
        (tmp_path / "dialect" / f"wingbeat_dialect_{dialect.fingerprint()}.py").write_text("x = (")
    else:
        (tmp_path / "dialect").write_text("not a folder")
    assert dialect.load_dialect().MAVLINK_MSG_ID_WINGBEAT_ENCODER == 53000


def test_a_serial_peer_that_stops_reading_makes_nobody_wait() -> None:
    """GIVEN a wire whose other end is full THEN what it does not take is counted, and what it says is heard."""
    master, slave = os.openpty()
    tty.setraw(slave)
    link = open_transport(f"serial:{os.ttyname(slave)},57600")
    try:
        for _ in range(2000):
            link.send(bytes(100))
        assert link.dropped > 0
        os.write(master, b"still here")
        assert b"".join(packet.data for packet in link.receive(0.0)) == b"still here"
    finally:
        link.close()
        os.close(master)
        os.close(slave)


@pytest.fixture
def ends() -> Iterator[tuple[SocketStream, socket.socket]]:
    """A lockstep stream, and the partner's bare socket."""
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as here:
        there, _ = server.accept()
        with there:
            yield SocketStream(here, "partner"), there


@pytest.mark.parametrize("busy_poll", [False, True])
def test_a_stream_gives_what_comes_waits_no_longer_than_asked_and_knows_who_has_gone(
    ends: tuple[SocketStream, socket.socket], busy_poll: bool
) -> None:
    stream, partner = ends
    if busy_poll:
        stream.enable_busy_poll()
    assert stream.read(0.001) == b""
    partner.sendall(b"tick")
    assert stream.read(PATIENCE) == b"tick"
    assert stream.write(b"tock") and partner.recv(16) == b"tock"
    partner.close()
    assert stream.read(PATIENCE) is None


def test_more_than_the_partner_has_room_for_is_written_as_it_reads(ends: tuple[SocketStream, socket.socket]) -> None:
    stream, partner = ends
    data = bytes(range(256)) * 65536
    read = bytearray()

    def reads() -> None:
        while len(read) < len(data):
            read.extend(partner.recv(1 << 20))

    reader = threading.Thread(target=reads)
    reader.start()
    assert stream.write(data)
    reader.join(PATIENCE)
    assert read == data


def test_who_reads_nothing_is_given_up(
    ends: tuple[SocketStream, socket.socket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(transport, "WRITE_PATIENCE", 0.05)
    assert not ends[0].write(bytes(1 << 26))


def test_an_end_in_a_hurry_sleeps_again_when_answers_are_late(ends: tuple[SocketStream, socket.socket]) -> None:
    """GIVEN a partner that does not answer WHEN it was waited for often THEN waiting costs no processor any more."""
    stream, _ = ends
    stream.enable_busy_poll()
    for _ in range(CREDIT):
        stream.read(0.0)
    begun = time.thread_time()
    stream.read(0.1)
    assert time.thread_time() - begun < 0.05


def test_late_answers_are_forgotten_after_many_in_time(ends: tuple[SocketStream, socket.socket]) -> None:
    stream, partner = ends
    stream.enable_busy_poll()
    for _ in range(CREDIT - 1):
        stream.read(0.0)
    for _ in range(RENEWED):
        partner.sendall(b"x")
        assert stream.read(PATIENCE) == b"x"
    assert stream._credit == CREDIT
