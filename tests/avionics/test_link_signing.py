"""Message signing: pymavlink signs and checks on the other end, over real sockets and into real files."""

from __future__ import annotations

import os
import socket
import stat
import time
import tty
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from link_station import PATIENCE
from link_vehicle import FakeVehicle
from ports import free_port

from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader
from avionics.link.ground import Files, GroundLink
from avionics.link.key_file import KeyFile, load_signing
from avionics.link.signing import EPOCH, FRESH, MAX_STREAMS, RESERVE, TICKS_PER_SECOND, Finding, Signing, Stamps
from avionics.messages import CommandKind
from wingbeat.errors import InputError

KEY = bytes(range(32))
OTHER = bytes(range(1, 33))
NOW = EPOCH + 3.0e8
TICKS = round(3.0e8 * TICKS_PER_SECOND)


class Station:
    """A socket, and pymavlink's own signing on it."""

    def __init__(self, port: int, key: bytes | None, stamp: int = TICKS, system: int = 255) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.mav: Any = mavlink.MAVLink(None, system, 190)
        self.received: list[Any] = []
        self.use(key, stamp)

    def use(self, key: bytes | None, stamp: int = TICKS) -> None:
        signing = self.mav.signing
        signing.secret_key, signing.sign_outgoing, signing.timestamp = key, key is not None, stamp

    def put(self, message: Any) -> bytes:
        data = bytes(message.pack(self.mav))
        self.socket.send(data)
        return data

    def receive(self) -> list[Any]:
        """Everything that is signed as it must be; pymavlink raises for anything else."""
        while True:
            try:
                data = self.socket.recv(2048)
            except BlockingIOError:
                return self.received
            self.received.append(self.mav.decode(bytearray(data)))


class Ground:
    """A vehicle's link, polled until it has taken what was sent."""

    def __init__(self, link: GroundLink, vehicle: FakeVehicle) -> None:
        self.link, self.vehicle = link, vehicle
        self.now = 0.0

    def take(self, station: Station) -> list[Any]:
        """Poll until the datagrams on the way have been taken; the inputs."""
        before, inputs = self.link.counts[0].frames, []
        deadline = time.monotonic() + PATIENCE
        while self.link.counts[0].frames == before:
            assert time.monotonic() < deadline
            inputs += self.link.poll(self.now)
        self.vehicle.apply(inputs)
        inputs += self.link.poll(self.now)
        self.now += 2.0
        self.link.poll(self.now)
        station.receive()
        return inputs


@contextmanager
def grounded(signing: Signing | None, options: str = "") -> Iterator[tuple[Ground, int]]:
    port, vehicle = free_port(), FakeVehicle()
    link = GroundLink(
        [f"udpin:127.0.0.1:{port}{options}"], vehicle, unix_time=lambda: NOW, files=Files(signing=signing)
    )
    try:
        yield Ground(link, vehicle), port
    finally:
        link.close()


def arm() -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)


def setup(key: bytes, stamp: int = 0, target: int = 1) -> Any:
    return mavlink.MAVLink_setup_signing_message(target, 1, list(key), stamp)


def texts(station: Station) -> str:
    return " | ".join(message.text for message in station.received if message.get_type() == "STATUSTEXT")


def kinds(inputs: list[Any]) -> list[CommandKind]:
    return [each.kind for each in inputs]


def test_signed_frames_are_obeyed_and_answered_with_signed_ones() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        station = Station(port, KEY)
        station.put(arm())
        assert kinds(ground.take(station)) == [CommandKind.ARM]
        acks = [message for message in station.received if message.get_type() == "COMMAND_ACK"]
        assert [ack.result for ack in acks] == [mavlink.MAV_RESULT_ACCEPTED]
        assert all(message.get_signed() for message in station.received)
        stamps = [message.get_msgbuf()[-12:-6] for message in station.received]
        numbers = [int.from_bytes(stamp, "little") for stamp in stamps]
        assert numbers == sorted(set(numbers)) and numbers[0] >= TICKS


@pytest.mark.parametrize("key", [None, OTHER])
def test_what_is_not_signed_with_the_key_is_refused_counted_and_told_once(key: bytes | None) -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        stranger, owner = Station(port, key), Station(port, KEY, system=254)
        for _ in range(3):
            stranger.put(arm())
            assert ground.take(stranger) == []
        counts = ground.link.counts[0]
        assert (counts.unsigned, counts.forged, counts.replayed) == ((3, 0, 0) if key is None else (0, 3, 0))
        assert stranger.received == [] and not ground.vehicle.armed
        kind = "unsigned" if key is None else "wrong signature"
        logged = [event.text for event in ground.link.take_events()]
        assert f"1 frames rejected on {counts.url}: {kind}" in logged
        owner.put(arm())
        ground.take(owner)
        assert ground.vehicle.armed
        said = f"{kind} frames rejected on {counts.url}"
        assert logged.count(said) == 1 and said not in texts(owner), "told before the owner was heard"


def test_a_first_refusal_is_told_with_the_tick_that_meets_it() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        ground.link.poll(0.0)  # nothing to complain of yet
        Station(port, None).put(arm())
        ground.now = 0.005
        before = ground.link.counts[0].frames
        while ground.link.counts[0].frames == before:
            ground.link.poll(ground.now)
        assert f"1 frames rejected on {ground.link.counts[0].url}: unsigned" in [
            event.text for event in ground.link.take_events()
        ]


def test_a_station_that_listens_is_told_of_forgeries_once() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        owner, forger = Station(port, KEY), Station(port, OTHER, system=254)
        owner.put(arm())
        ground.take(owner)
        for _ in range(3):
            forger.put(arm())
            ground.take(owner)
        assert texts(owner).replace(" | ", "").count("wrong signature frames rejected") == 1


def test_the_counters_travel_while_there_is_a_key() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        owner, forger = Station(port, KEY), Station(port, OTHER, system=254)
        owner.put(arm())
        ground.take(owner)
        for _ in range(3):
            forger.put(arm())
            ground.take(owner)
        told = {each.name: each.value for each in owner.received if each.get_type() == "NAMED_VALUE_INT"}
        assert (told["sig_unsign"], told["sig_replay"]) == (0, 0) and told["sig_forged"] >= 2
    assert any("forged 3" in event.text for event in ground.link.take_events())


def test_a_replayed_frame_is_refused_and_an_older_one_too() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        station = Station(port, KEY)
        first = station.put(arm())
        assert kinds(ground.take(station)) == [CommandKind.ARM]
        for _ in range(2):
            station.socket.send(first)
            assert ground.take(station) == []
        station.use(KEY, TICKS - 5)
        station.put(arm())
        assert ground.take(station) == []
        assert ground.link.counts[0].replayed == 3


def test_a_sender_that_was_never_heard_may_be_a_minute_late_and_no_more() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        for system, behind, received in ((1, FRESH + 10, 0), (2, FRESH - 10, 1)):
            station = Station(port, KEY, TICKS - behind, system + 10)
            station.put(arm())
            assert len(ground.take(station)) == received


def test_a_forged_time_stamp_does_not_silence_the_owner() -> None:
    with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
        owner, forger = Station(port, KEY), Station(port, OTHER, TICKS + 10**9)
        forger.put(arm())
        assert ground.take(owner) == []
        owner.put(arm())
        assert kinds(ground.take(owner)) == [CommandKind.ARM]


# --- clocks that differ ------------------------------------------------------------------------------------

A, B, C = 255, 254, 253
UNSET = -1.0e9
"""s; error of a clock that was never set"""


def heartbeat(seconds: float, system: int) -> Frame:
    """A signed HEARTBEAT of a station whose clock is ``seconds`` after `NOW`."""
    sender: Any = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    sender.signing.secret_key, sender.signing.sign_outgoing = KEY, True
    sender.signing.timestamp = TICKS + round(seconds * TICKS_PER_SECOND)
    return FrameReader(foreign=True).feed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(sender))[0]


class Clocks:
    """A vehicle and stations, each with a clock of its own; ``time`` is the true time since `NOW`."""

    def __init__(self, vehicle_error: float = 0.0, stamps: Stamps = Stamps()) -> None:  # noqa: B008 (immutable)
        self.time, self.vehicle_error = 0.0, vehicle_error
        self.vehicle = Signing(lambda: NOW + self.time + self.vehicle_error, KEY, stamps, None, lambda: self.time)

    def examine(self, system: int, error: float) -> Finding:
        return self.vehicle.examine(heartbeat(self.time + error, system))


@pytest.mark.parametrize("ahead", [30.0, 59.0, 61.0, 70.0, 120.0, 3600.0, 3.0e7])
@pytest.mark.parametrize("first", [A, B])
def test_a_station_with_a_clock_ahead_locks_nobody_out(ahead: float, first: int) -> None:
    """GIVEN two stations with one key THEN the one with the right clock is accepted, known before or new, always."""
    clocks = Clocks()
    clocks.examine(first, 0.0 if first == A else ahead)
    found = Counter[tuple[int, Finding]]()
    for _ in range(200):
        clocks.time += 1.0
        found[A, clocks.examine(A, 0.0)] += 1
        found[B, clocks.examine(B, ahead)] += 1
    assert found[A, Finding.SIGNED] == 200
    assert clocks.examine(C, -59.0) is Finding.SIGNED, "a new station a minute behind"
    accepted = ahead < 60.0 or first == B
    assert found[B, Finding.SIGNED if accepted else Finding.AHEAD] == 200


def test_a_known_stream_is_compared_with_its_own_time_stamps_alone() -> None:
    """GIVEN a stream that began a minute behind WHEN the vehicle's clock is set THEN it goes on, and old is old."""
    clocks = Clocks()
    assert clocks.examine(A, -59.0) is Finding.SIGNED
    for clocks.vehicle_error in (500.0, -500.0):
        for _ in range(100):
            clocks.time += 1.0
            assert clocks.examine(A, -59.0) is Finding.SIGNED
        assert clocks.examine(A, -59.0) is Finding.REPLAYED
        assert clocks.examine(A, -59.001) is Finding.REPLAYED
    assert clocks.examine(A, 600.0) is Finding.AHEAD, "one wrong time stamp does not end the stream"
    clocks.time += 1.0
    assert clocks.examine(A, -59.0) is Finding.SIGNED


@pytest.mark.parametrize("error", [UNSET, -86_400.0, -300.0])
def test_the_first_frame_sets_up_a_vehicle_whose_clock_is_behind(error: float) -> None:
    """GIVEN a clock that was never set, or is behind THEN the first station is accepted, others, and later ones."""
    clocks = Clocks(error)
    assert clocks.examine(A, 0.0) is Finding.SIGNED
    clocks.time += 200.0
    assert clocks.examine(B, 30.0) is Finding.SIGNED
    assert clocks.examine(C, 61.0) is Finding.AHEAD
    stamp = int.from_bytes(clocks.vehicle.sign(b"frame", 0)[1:7], "little")
    assert abs(stamp - TICKS - 200 * TICKS_PER_SECOND) < FRESH, "a station with a right clock accepts it"
    assert clocks.examine(C, -61.0) is Finding.SIGNED, "the first station's clock is not the vehicle's"


def test_after_a_restart_without_a_clock_old_frames_of_new_streams_are_refused() -> None:
    kept = Stamps(TICKS + FRESH, {(A, 190, 0): TICKS}, TICKS)
    assert Clocks(0.0, kept).examine(C, -59.0) is Finding.SIGNED
    clocks = Clocks(UNSET, kept)
    assert clocks.examine(C, -61.0) is Finding.REPLAYED
    assert clocks.examine(A, 0.0) is Finding.REPLAYED
    assert clocks.examine(A, 1.0) is Finding.SIGNED


def test_setting_the_clock_after_the_first_frame_moves_no_time_stamp() -> None:
    """GIVEN a clock that was never set WHEN GPS or NTP sets it THEN stations go on, and what is sent is of now."""
    clocks = Clocks(UNSET)
    assert clocks.examine(A, 0.0) is Finding.SIGNED
    clocks.vehicle_error = 0.0
    for system in (A, B, C):
        clocks.time += 1.0
        stamp = int.from_bytes(clocks.vehicle.sign(b"frame", 0)[1:7], "little")
        assert abs(stamp - TICKS - clocks.time * TICKS_PER_SECOND) < FRESH
        assert clocks.examine(system, 0.0) is Finding.SIGNED


def test_a_stream_cannot_step_ahead() -> None:
    """GIVEN a known stream WHEN each frame is 59 s later than the last THEN it stays within a minute of the clock."""
    clocks = Clocks()
    found = [clocks.examine(A, 59.0 * step) for step in range(100)]
    assert found[:2] == [Finding.SIGNED] * 2 and set(found[2:]) == {Finding.AHEAD}
    assert clocks.examine(B, 3600.0) is Finding.AHEAD


def test_the_first_frame_after_a_restart_sets_a_clock_that_is_not_set() -> None:
    """GIVEN a restart a minute, to the tick, after the last stored time stamp THEN the station stays accepted."""
    clocks = Clocks(UNSET)
    assert clocks.examine(A, 0.0) is Finding.SIGNED
    for elapsed, restart in ((1.28125, True), (1.796875, False), (60.0, True), (1.71875, False)):
        clocks.time += elapsed
        if restart:
            stamps = clocks.vehicle._stamps()
            clocks.vehicle = Signing(
                lambda: NOW + clocks.time + clocks.vehicle_error, KEY, stamps, None, lambda: clocks.time
            )
        assert clocks.examine(A, 0.0) is Finding.SIGNED
        clocks.vehicle.sign(b"frame", 0)


@given(st.data())
def test_a_station_with_the_right_clock_is_always_accepted(data: st.DataObject) -> None:
    """Over jumps of the clock, wrong stations and restarts; what is sent stays acceptable to that station."""
    error = data.draw(st.sampled_from([0.0, UNSET, -300.0, -86_400.0]))
    clocks = Clocks(error)
    assert clocks.examine(A, 0.0) is Finding.SIGNED
    for _ in range(data.draw(st.integers(1, 12))):
        clocks.time += data.draw(st.floats(0.5, 400.0))
        match data.draw(st.sampled_from(["jump", "wrong", "restart", "none"])):
            case "jump":
                clocks.vehicle_error = data.draw(st.sampled_from([0.0, 30.0, -30.0, error]))
            case "wrong":
                clocks.examine(data.draw(st.sampled_from([B, C])), data.draw(st.floats(-1e8, 1e8)))
            case "restart":
                stamps = clocks.vehicle._stamps()
                clocks.vehicle = Signing(
                    lambda: NOW + clocks.time + clocks.vehicle_error, KEY, stamps, None, lambda: clocks.time
                )
        assert clocks.examine(A, 0.0) is Finding.SIGNED
        stamp = int.from_bytes(clocks.vehicle.sign(b"frame", 0)[1:7], "little")
        assert stamp > TICKS + (clocks.time - 61.0) * TICKS_PER_SECOND


def test_the_streams_that_are_remembered_are_bounded() -> None:
    clocks = Clocks()
    for system in range(1, MAX_STREAMS + 20):
        clocks.time += 0.5
        assert clocks.examine(system, 0.0) is Finding.SIGNED
    assert len(clocks.vehicle._streams) <= MAX_STREAMS + 4


@pytest.mark.parametrize(("kind", "refused"), [("serial", 0), ("udp", 1)])
def test_a_radio_needs_no_signature_on_its_own_wire(kind: str, refused: int) -> None:
    """GIVEN a key THEN a radio's word about its buffer counts on a serial line, a stranger's on a network not."""
    status = mavlink.MAVLink_radio_status_message(1, 1, 99, 1, 1, 0, 0)
    if kind == "udp":
        with grounded(Signing(lambda: NOW, KEY)) as (ground, port):
            radio = Station(port, None, system=51)
            radio.put(status)
            ground.take(radio)
            assert ground.link.counts[0].unsigned == refused
        return
    master, slave = os.openpty()
    tty.setraw(slave)
    url, files = f"serial:{os.ttyname(slave)},57600", Files(signing=Signing(lambda: NOW, KEY))
    link = GroundLink([url], FakeVehicle(), files=files)
    try:
        os.write(master, status.pack(mavlink.MAVLink(None, 51, 68)))
        link.poll(1.0)
        assert (link.counts[0].unsigned, link.counts[0].frames) == (refused, 1)
    finally:
        link.close()
        os.close(master)
        os.close(slave)


def test_a_link_that_the_user_trusts_needs_no_signature_but_for_another_key() -> None:
    with grounded(Signing(lambda: NOW, KEY), "?unsigned=accept") as (ground, port):
        stranger, forger = Station(port, None), Station(port, OTHER)
        stranger.put(arm())
        assert kinds(ground.take(stranger)) == [CommandKind.ARM]
        forger.put(arm())
        assert ground.take(forger) == [] and ground.link.counts[0].forged == 1
        stranger.put(setup(OTHER))
        ground.take(stranger)
        assert ground.link.counts[0].unsigned == 1
        stranger.put(arm())
        assert kinds(ground.take(stranger)) == [CommandKind.ARM]


# --- SETUP_SIGNING -------------------------------------------------------------------------------------------


def test_setup_signing_sets_changes_and_removes_the_key(tmp_path: Path) -> None:
    file = KeyFile(tmp_path / "state" / "bird.key")
    with grounded(load_signing(file, lambda: NOW)) as (ground, port):
        station = Station(port, None)
        station.put(setup(KEY, TICKS))
        ground.take(station)
        assert file.load_key() == KEY and texts(station).startswith("signing: on")
        assert file.path.stat().st_mode & 0o777 == 0o600
        station.put(setup(OTHER))
        ground.take(station)
        assert file.load_key() == KEY and ground.link.counts[0].unsigned == 1
        station.use(KEY, TICKS + 5)
        station.put(setup(OTHER))
        ground.take(Station(port, OTHER))
        assert file.load_key() == OTHER
        station.use(OTHER, TICKS + 10)
        station.put(setup(bytes(32)))
        ground.take(Station(port, None))
        assert not file.path.exists()
        station.use(None)
        station.put(arm())
        assert kinds(ground.take(station)) == [CommandKind.ARM]
        told = repr(ground.link.take_events()) + texts(station)
        assert KEY.hex() not in told and OTHER.hex() not in told and str(list(KEY)) not in told


@pytest.mark.parametrize(
    ("armed", "target", "stamp", "word"),
    [(True, 1, 0, "armed"), (False, 0, 0, "one vehicle"), (False, 1, (1 << 47) + 1, "too late")],
)
def test_a_key_is_refused(armed: bool, target: int, stamp: int, word: str) -> None:
    with grounded(None) as (ground, port):
        ground.vehicle.armed = armed
        station = Station(port, None)
        station.put(setup(KEY, stamp, target))
        ground.take(station)
        assert word in texts(station)
        station.put(arm())
        assert kinds(ground.take(station)) == [CommandKind.ARM]


def test_a_key_is_taken_only_where_nobody_else_hears_it() -> None:
    with grounded(None) as (ground, _):
        channel = ground.link._links[0]
        assert channel.confidential(("127.0.0.1", 5)) and channel.confidential(("::1", 5, 0, 0))
        assert not channel.confidential(("192.168.1.20", 5)) and not channel.confidential("somebody")


# --- files ---------------------------------------------------------------------------------------------------


def key_file(folder: Path, text: str) -> KeyFile:
    path = folder / "bird.key"
    path.touch(0o600)
    path.write_text(text)
    return KeyFile(path)


@pytest.mark.parametrize("clean", [True, False])
def test_after_a_restart_nothing_can_be_said_again_and_our_stamps_still_rise(tmp_path: Path, clean: bool) -> None:
    file = key_file(tmp_path, KEY.hex())
    first = load_signing(file, lambda: NOW)
    with grounded(first) as (ground, port):
        station = Station(port, KEY)
        frames = []
        for _ in range(4):
            frames.append(station.put(arm()))
            ground.take(station)
        used = max(int.from_bytes(message.get_msgbuf()[-12:-6], "little") for message in station.received)
        kept = file.load_stamps()
        if not clean:
            ground.link._signing = Signing(lambda: NOW)  # a crash: nothing is written any more
    if clean:
        kept = file.load_stamps()
    assert kept.local >= used and kept.clock == TICKS
    # Afterwards the vehicle's clock is years behind: it has no battery.
    again = load_signing(file, lambda: EPOCH)
    with grounded(again) as (ground, port):
        station = Station(port, KEY, TICKS + RESERVE + 100)
        for frame in frames:
            station.socket.send(frame)
            assert ground.take(station) == []
        assert ground.link.counts[0].replayed == len(frames)
        station.put(arm())
        assert kinds(ground.take(station)) == [CommandKind.ARM]
        after = [int.from_bytes(message.get_msgbuf()[-12:-6], "little") for message in station.received]
        assert min(after) > used


def test_a_key_outlives_a_power_cut_and_a_flight_waits_for_no_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a key file WHEN a key comes or goes, or the link is closed THEN file and folder are on the disk."""
    synced: list[str] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(stat_name(descriptor)))
    now = [NOW]
    signing = load_signing(KeyFile(tmp_path / "bird.key"), lambda: now[0])
    signing.set_key(KEY)
    assert synced == ["file", "folder"]
    for _ in range(10):
        now[0] += 3.0
        signing.sign(b"frame", 0)
    assert synced == ["file", "folder"]
    signing.close()
    assert synced == ["file", "folder"] * 2
    signing.set_key(None)
    assert synced == [*["file", "folder"] * 2, "folder"]


def stat_name(descriptor: int) -> str:
    return "folder" if stat.S_ISDIR(os.fstat(descriptor).st_mode) else "file"


def test_a_passphrase_is_the_key_that_mavproxy_makes_of_it(tmp_path: Path) -> None:
    import hashlib

    file = key_file(tmp_path, "passphrase the goose is loose\n")
    assert file.load_key() == hashlib.sha256(b"the goose is loose").digest()


@pytest.mark.parametrize(
    ("text", "mode", "word"),
    [("", 0o600, "hexadecimal"), ("00ff", 0o600, "hexadecimal"), (KEY.hex(), 0o640, "chmod 600"),
     (KEY.hex(), 0o604, "chmod 600")],
)  # fmt: skip
def test_a_key_file_that_cannot_be_used_is_refused_in_one_line_without_the_key(
    tmp_path: Path, text: str, mode: int, word: str
) -> None:
    file = key_file(tmp_path, text)
    file.path.chmod(mode)
    with pytest.raises(InputError) as refused:
        file.load_key()
    assert word in str(refused.value) and "\n" not in str(refused.value)
    assert KEY.hex() not in str(refused.value)


def test_damaged_time_stamps_are_refused(tmp_path: Path) -> None:
    file = key_file(tmp_path, KEY.hex())
    file.path.with_name("bird.key.stamps").write_text('{"ours": 3')
    with pytest.raises(InputError, match="damaged"):
        load_signing(file)


def test_a_folder_that_cannot_be_written_stops_no_flight_and_is_told(tmp_path: Path) -> None:
    file = key_file(tmp_path, KEY.hex())
    signing = load_signing(file, lambda: NOW)
    file.path.with_name("bird.key.stamps").mkdir()
    with grounded(signing) as (ground, port):
        station = Station(port, KEY)
        station.put(arm())
        assert kinds(ground.take(station)) == [CommandKind.ARM]
        assert "time stamps not stored" in texts(station).replace(" | ", "")


def test_the_key_shows_nowhere(tmp_path: Path) -> None:
    signing = Signing(lambda: NOW, KEY)
    assert repr(signing) == "Signing(on)"


def test_a_first_time_stamp_far_ahead_would_shut_everybody_out() -> None:
    signing = Signing(lambda: NOW)
    assert not signing.too_far_ahead(0)
    assert not signing.too_far_ahead(TICKS + 3600 * TICKS_PER_SECOND)
    assert signing.too_far_ahead(TICKS + 2 * 86_400 * TICKS_PER_SECOND)
    assert Signing(lambda: 0.0).too_far_ahead(1 << 47)
    assert not Signing(lambda: 0.0).too_far_ahead(TICKS)
