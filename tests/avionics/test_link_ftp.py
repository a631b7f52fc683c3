"""MAVLink FTP: pymavlink's own client against the vehicle, and what no honest client asks."""

from __future__ import annotations

import os
import random
import struct
import time
import zlib
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from link_station import PATIENCE, greet, running
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire
from ports import free_port
from pymavlink import mavftp, mavutil

from avionics.link.dialect import mavlink
from avionics.link.ftp_files import pack_parameters
from avionics.link.ground import Files, GroundLink
from avionics.link.services.ftp import BURST, BURST_PER_STEP, MOST_SESSIONS
from avionics.link.vehicle import Parameter

LOG = random.Random(3).randbytes(40_000)
LIST, OPEN, READ, CHECKSUM, BURST_READ = 3, 4, 5, 14, 15
ACK, NAK = 128, 129
FAIL, INVALID_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, UNKNOWN, PROTECTED, NOT_FOUND = (
    1, 3, 4, 5, 6, 7, 9, 10,
)  # fmt: skip


@pytest.fixture
def logs(tmp_path: Path) -> Path:
    folder = tmp_path / "recordings"
    folder.mkdir()
    (folder / "flight-1.mcap").write_bytes(LOG)
    (folder / "empty.mcap").touch()
    (folder / "notes.txt").write_text("not a log")
    (folder / "folder.mcap").mkdir()
    (tmp_path / "secret.mcap").write_text("outside")
    (folder / "link.mcap").symlink_to(tmp_path / "secret.mcap")
    return folder


class Defaults:
    """A parameter file in which CLIMB_P was changed."""

    def defaults(self) -> dict[str, float]:
        return {each.name: each.value for each in FakeVehicle().parameters} | {"CLIMB_P": 0.25}

    def stored(self) -> dict[str, float]:
        return {}

    def save(self, values: Any) -> None:
        raise OSError


# --- the stock client ----------------------------------------------------------------------------------------


@contextmanager
def stock_ftp(logs: Path) -> Iterator[Any]:
    port, vehicle = free_port(), FakeVehicle()
    link = GroundLink([f"udpin:127.0.0.1:{port}"], vehicle, files=Files(Defaults(), None, logs))
    with running(link, vehicle):
        client = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=255, dialect="development")
        try:
            greet(client)
            yield mavftp.MAVFTP(client, target_system=1, target_component=1)
        finally:
            client.close()


def fetched(ftp: Any, path: str) -> bytes:
    """A file as pymavlink's client gets it, by bursts."""
    got: list[bytes] = []
    ftp.cmd_get([path, "-"], callback=lambda file: got.append(file.read() if file is not None else b"failed"))
    deadline = time.monotonic() + PATIENCE
    while not got and time.monotonic() < deadline:
        ftp.process_ftp_reply("OpenFileRO", timeout=PATIENCE)
    assert got, f"{path} never came"
    return got[0]


def test_pymavlinks_client_lists_and_fetches_a_log_whole(logs: Path) -> None:
    with stock_ftp(logs) as ftp:
        ftp.cmd_list(["/logs"])
        ftp.process_ftp_reply("ListDirectory", timeout=5)
        assert [(each.name, each.is_dir, each.size_b) for each in ftp.list_result] == [
            ("empty.mcap", False, 0), ("flight-1.mcap", False, len(LOG))
        ]  # fmt: skip
        assert fetched(ftp, "/logs/flight-1.mcap") == LOG


def test_pymavlinks_client_reads_the_parameters_and_their_defaults(logs: Path) -> None:
    with stock_ftp(logs) as ftp:
        data = mavftp.MAVFTP.ftp_param_decode(fetched(ftp, "@PARAM/param.pck?withdefaults=1"))
        names = [(name.decode(), value) for name, value, _ in data.params]
        assert names == [(each.name, pytest.approx(each.value)) for each in FakeVehicle().parameters]
        defaults = {name.decode(): value for name, value, _ in data.defaults}
        assert defaults["CLIMB_P"] == pytest.approx(0.25) and defaults["PITCH_P"] == pytest.approx(0.8)


def test_names_of_every_length_survive_the_packing() -> None:
    generator = random.Random(8)
    names = {"".join(generator.choice("AB_") for _ in range(generator.randint(1, 16))) for _ in range(300)}
    table = [Parameter(name, generator.uniform(-1e3, 1e3), 0.0, 0.0) for name in sorted(names)]
    data = mavftp.MAVFTP.ftp_param_decode(pack_parameters(table))
    assert [(name.decode(), value) for name, value, _ in data.params] == [
        (each.name, pytest.approx(each.value, rel=1e-6)) for each in table
    ]


# --- request by request --------------------------------------------------------------------------------------


class Request:
    """Requests on a wire, and their answers."""

    def __init__(self, logs: Path | None, url: str = "udpin:127.0.0.1:1") -> None:
        self.wire, self.sequence, self.now = Wire(url), 100, 0.0
        self.link = GroundLink([self.wire], FakeVehicle(), files=Files(logs=logs))
        self.frame_of = Voice(255).frame

    def send(self, opcode: int, data: bytes = b"", session: int = 0, offset: int = 0, size: int = -1) -> None:
        self.sequence += 1
        length = len(data) if size < 0 else size
        header = struct.pack("<HBBBBBBI", self.sequence, session, opcode, length, 0, 0, 0, offset)
        payload = list((header + data).ljust(251, b"\0")[:251])
        self.wire.put(self.frame_of(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, payload)))
        self.step()

    def step(self) -> None:
        self.now += 0.004
        self.link.poll(self.now)

    def answers(self) -> list[tuple[Any, ...]]:
        """Sequence, session, opcode, size, requested opcode, burst complete, offset and data of each."""
        got = [each.payload for each in self.wire.incoming() if each.get_type() == "FILE_TRANSFER_PROTOCOL"]
        fields = [struct.unpack("<HBBBBBBI", bytes(payload[:12])) for payload in got]
        return [
            (*each[:6], each[7], bytes(payload[12 : 12 + each[3]])) for each, payload in zip(fields, got, strict=True)
        ]

    def request(self, *args: Any, **options: Any) -> tuple[int, bytes]:
        """Opcode and data of the one answer."""
        self.answers()
        self.send(*args, **options)
        (answer,) = self.answers()
        assert answer[0] == self.sequence + 1
        return answer[2], answer[7]


def nak(error: int) -> tuple[int, bytes]:
    return NAK, bytes([error])


@pytest.mark.parametrize(
    "path",
    ["/secret.mcap", "../secret.mcap", "/logs/../secret.mcap", "logs/../../secret.mcap", "/etc/passwd", "/logs",
     "/logs/link.mcap", "/logs/folder.mcap", "/logs/notes.txt", "/logs/", "/logs//flight-1.mcap", "//etc/passwd",
     "/logs/./flight-1.mcap", "/logs/..", "@PARAM/../logs/flight-1.mcap", "@PARAM/param.pck/..", "@MAV_LOG/../x",
     "/logs/flight-1.mcap/", "/logs/flight-1.mcap\n", "", "\xff\xfe", "~/.ssh/id_rsa", "/logs\\..\\secret.mcap"],
)  # fmt: skip
def test_no_path_leads_out_of_the_shelf(logs: Path, path: str) -> None:
    asked = Request(logs)
    absolute = str(logs.parent / "secret.mcap")
    for each in (path, f"/logs/{absolute}", absolute):
        assert asked.request(OPEN, each.encode("latin-1")) == nak(NOT_FOUND)
        assert asked.request(CHECKSUM, each.encode("latin-1")) == nak(NOT_FOUND)


@pytest.mark.parametrize("path", ["/..", "..", "/logs/..", "/etc", ".", "@SYS", "logs/x"])
def test_no_folder_but_the_logs_is_listed(logs: Path, path: str) -> None:
    assert Request(logs).request(LIST, path.encode()) == nak(NOT_FOUND)


def test_folders_are_listed_to_their_end(logs: Path) -> None:
    asked = Request(logs)
    assert asked.request(LIST, b"/") == (ACK, b"Dlogs\0")
    for name in (b"/logs", b"@MAV_LOG"):
        assert asked.request(LIST, name) == (ACK, b"Fempty.mcap\t0\0Fflight-1.mcap\t40000\0")
        assert asked.request(LIST, name, offset=1) == (ACK, b"Fflight-1.mcap\t40000\0")
        assert asked.request(LIST, name, offset=2) == nak(END_OF_FILE)
    assert Request(None).request(LIST, b"/logs") == nak(END_OF_FILE)


@pytest.mark.skipif(os.name != "posix", reason="file names are bytes")
@pytest.mark.parametrize(
    ("name", "listed"),
    [(b"M\xfcnchen.mcap", b"M\\udcfcnchen.mcap"), (b"a\tb\nc\x1b[2J.mcap", b"a\\tb\\nc\\x1b[2J.mcap"),
     ("M\u00fcnchen.mcap".encode(), "M\u00fcnchen.mcap".encode()), (b"x" * 240 + b".mcap", b"")],
)  # fmt: skip
def test_a_file_of_any_name_is_listed_or_left_out(logs: Path, name: bytes, listed: bytes) -> None:
    """GIVEN a name that is no UTF-8, has control characters or is too long THEN the others are listed."""
    (logs / os.fsdecode(name)).write_bytes(LOG)
    asked, found, offset = Request(logs), list[bytes](), 0
    while (answer := asked.request(LIST, b"/logs", offset=offset))[0] == ACK:
        entries = answer[1].removesuffix(b"\0").split(b"\0")
        found, offset = found + entries, offset + len(entries)
    expected = {b"Fempty.mcap\t0", b"Fflight-1.mcap\t40000"} | ({b"F" + listed + b"\t40000"} if listed else set())
    assert set(found) == expected and answer == nak(END_OF_FILE)
    if listed:
        assert asked.request(OPEN, b"/logs/" + listed) == (ACK, struct.pack("<I", len(LOG)))
        assert asked.request(READ, offset=100, size=50) == (ACK, LOG[100:150])


@pytest.mark.parametrize("opcode", [6, 7, 8, 9, 10, 11, 12, 13])
def test_nothing_can_be_written(logs: Path, opcode: int) -> None:
    before = sorted(logs.iterdir())
    assert Request(logs).request(opcode, b"/logs/flight-1.mcap") == nak(PROTECTED)
    assert sorted(logs.iterdir()) == before and (logs / "flight-1.mcap").read_bytes() == LOG


def test_what_is_no_request_of_ours_gets_a_nak(logs: Path) -> None:
    asked = Request(logs)
    assert asked.request(99, b"x") == nak(UNKNOWN)
    assert asked.request(READ, session=3, size=10) == nak(INVALID_SESSION)
    assert asked.request(BURST_READ, session=3, size=10) == nak(INVALID_SESSION)
    assert asked.request(OPEN, b"/logs/flight-1.mcap", size=240) == nak(INVALID_SIZE)
    asked.send(ACK, b"an answer is not answered")
    assert asked.answers() == []


def test_a_file_is_read_part_by_part_and_a_growing_one_as_it_was_opened(logs: Path) -> None:
    asked = Request(logs)
    assert asked.request(OPEN, b"/logs/flight-1.mcap", session=5) == (ACK, struct.pack("<I", len(LOG)))
    assert asked.request(READ, session=5, offset=39_900, size=200) == (ACK, LOG[39_900:])
    assert asked.request(READ, session=5, offset=40_000, size=200) == nak(END_OF_FILE)
    assert asked.request(READ, session=5, offset=2**32 - 1, size=200) == nak(END_OF_FILE)
    assert asked.request(OPEN, b"/logs/empty.mcap", session=6) == (ACK, bytes(4))
    assert asked.request(READ, session=6, size=10) == nak(END_OF_FILE)
    (logs / "flight-1.mcap").unlink()
    (logs / "flight-1.mcap").symlink_to(logs.parent / "secret.mcap")
    assert asked.request(READ, session=5, size=10) == nak(FAIL)
    assert asked.request(1, session=5) == (ACK, b"")
    assert asked.request(READ, session=5, size=10) == nak(INVALID_SESSION)


def test_a_burst_comes_in_order_and_ends_with_its_mark(logs: Path) -> None:
    asked = Request(logs)
    asked.request(OPEN, b"/logs/flight-1.mcap")
    got, offset = b"", 0
    while offset < len(LOG):
        asked.send(BURST_READ, offset=offset, size=239)
        begin = asked.sequence
        answers: list[tuple[Any, ...]] = []
        while not answers or not answers[-1][5]:
            asked.step()
            answers += asked.answers()
        assert [each[0] for each in answers] == list(range(begin + 1, begin + 1 + len(answers)))
        assert len(answers) <= BURST and not any(each[5] for each in answers[:-1])
        for each in answers:
            assert each[6] == offset
            got, offset = got + each[7], offset + each[3]
        asked.sequence += len(answers)
    assert got == LOG
    assert asked.request(BURST_READ, offset=len(LOG), size=239) == nak(END_OF_FILE)


def test_many_bursts_at_once_send_no_more_in_a_tick_than_one(logs: Path) -> None:
    """GIVEN as many senders as there are sessions, each with a burst THEN a tick sends so much, all are served."""
    asked = Request(logs)
    stations = [Voice(system).frame for system in range(200, 200 + MOST_SESSIONS)]
    for asked.frame_of in stations:
        asked.request(OPEN, b"/logs/flight-1.mcap")
    for asked.frame_of in stations:
        asked.send(BURST_READ, size=239)

    def targets() -> list[int]:
        return [each.target_system for each in asked.wire.incoming() if each.get_type() == "FILE_TRANSFER_PROTOCOL"]

    received = Counter(targets())
    for _ in range(MOST_SESSIONS * BURST // BURST_PER_STEP):
        asked.step()
        sent = targets()
        assert len(sent) <= BURST_PER_STEP
        received.update(sent)
    assert received == dict.fromkeys(range(200, 200 + MOST_SESSIONS), BURST)


def test_a_request_that_comes_again_gets_the_same_answer(logs: Path) -> None:
    asked = Request(logs)
    asked.send(OPEN, b"/logs/flight-1.mcap")
    first = asked.answers()
    asked.sequence -= 1
    (logs / "flight-1.mcap").write_bytes(b"other")
    asked.send(OPEN, b"/logs/flight-1.mcap")
    assert asked.answers() == first


def reference_crc(data: bytes) -> int:
    """The checksum as PX4 and ArduPilot have it: the usual polynomial, begun with 0, not inverted."""
    crc = 0
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_the_checksum_is_that_of_the_other_autopilots(logs: Path) -> None:
    (logs / "long.mcap").write_bytes(LOG * 4)
    asked = Request(logs)
    asked.send(CHECKSUM, b"/logs/long.mcap")
    assert asked.answers() == [], "it is not taken all at once"
    for _ in range(4):
        asked.step()
    (answer,) = asked.answers()
    assert (answer[2], answer[4]) == (ACK, CHECKSUM)
    assert answer[7] == struct.pack("<I", reference_crc(LOG * 4))
    assert reference_crc(LOG) == zlib.crc32(LOG, 0xFFFFFFFF) ^ 0xFFFFFFFF
    assert asked.request(CHECKSUM, b"/logs/empty.mcap") == (ACK, bytes(4))


def test_sessions_are_each_senders_own_and_run_out(logs: Path) -> None:
    asked = Request(logs)
    asked.request(OPEN, b"/logs/flight-1.mcap", session=0)
    asked.frame_of = Voice(254).frame
    assert asked.request(READ, session=0, size=5) == nak(INVALID_SESSION)
    for number in range(MOST_SESSIONS - 1):
        assert asked.request(OPEN, b"/logs/flight-1.mcap", session=number)[0] == ACK
    assert asked.request(OPEN, b"/logs/flight-1.mcap", session=50) == nak(NO_SESSIONS)
    assert asked.request(2) == (ACK, b"")
    assert asked.request(OPEN, b"/logs/flight-1.mcap", session=50)[0] == ACK
    asked.frame_of = Voice(255).frame
    assert asked.request(READ, session=0, size=5) == (ACK, LOG[:5])


def test_a_burst_leaves_room_on_a_slow_link(logs: Path) -> None:
    asked = Request(logs, "udpin:127.0.0.1:1?rate=57600")
    asked.request(OPEN, b"/logs/flight-1.mcap")
    asked.send(BURST_READ, size=239)
    sent, began = 0, asked.now
    attitudes = 0
    while asked.now < began + 3.0:
        asked.step()
        asked.link.stream(asked.now)
        for each in asked.wire.incoming():
            sent += len(each.get_msgbuf())
            attitudes += each.get_type() == "ATTITUDE"
    assert sent <= 5760.0 * 3.25
    assert attitudes > 25


@pytest.mark.skipif(os.name != "posix", reason="needs symbolic links")
def test_random_requests_raise_nothing_and_leave_the_shelf_alone(logs: Path) -> None:
    asked, generator = Request(logs), random.Random(12)
    before = {path.name: path.lstat().st_mtime_ns for path in logs.iterdir()}
    texts = (b"", b"/logs", b"/logs/flight-1.mcap", b"@PARAM/param.pck", generator.randbytes(60))
    for _ in range(3000):
        offset, size = (
            generator.choice((0, generator.randrange(2**32))),
            generator.choice((-1, generator.randrange(256))),
        )
        data, session = generator.choice(texts), generator.randrange(4)
        asked.send(generator.randrange(20), data, session=session, offset=offset, size=size)
    assert {path.name: path.lstat().st_mtime_ns for path in logs.iterdir()} == before
    asked.wire.take()
    asked.frame_of = Voice(200).frame
    asked.now += 100.0
    assert asked.request(OPEN, b"/logs/flight-1.mcap")[0] == ACK
