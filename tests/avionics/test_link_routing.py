"""Several links at once: each with its own streams, and frames passed on between them."""

from __future__ import annotations

import itertools
import os
from typing import Any

import pytest
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire

from avionics.link.dialect import mavlink
from avionics.link.framing import Frame, FrameReader
from avionics.link.ground import Files, GroundLink
from avionics.link.routing import FORGET, MOST_KNOWN, Hop, Router, target_of
from avionics.link.signing import Signing

OURS = (1, 1)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def ping(system: int = 0, component: int = 0, sequence: int = 1) -> Any:
    return mavlink.MAVLink_ping_message(0, sequence, system, component)


def command(system: int, component: int) -> Any:
    return mavlink.MAVLink_command_long_message(system, component, 400, 0, 1, 0, 0, 0, 0, 0, 0)


def frame(message: Any, system: int, component: int = 190) -> Frame:
    return FrameReader().feed(Voice(system, component).frame(message))[0]


class Net:
    """A vehicle with several wires; time stands unless it is moved."""

    def __init__(self, *urls: str) -> None:
        self.wires = [Wire(url) for url in urls]
        self.vehicle = FakeVehicle()
        self.link = GroundLink(self.wires, self.vehicle)
        self.now = 100.0
        self.step()

    def step(self) -> None:
        self.vehicle.apply(self.link.poll(self.now))

    def pass_on(self, wire: int, data: bytes) -> list[list[bytes]]:
        """Say a frame on one wire; the same bytes wherever they came out."""
        for each in self.wires:
            each.take()
        self.wires[wire].put(data)
        self.step()
        return [[sent.data for sent in each.take() if sent.data == data] for each in self.wires]


def test_each_station_on_a_link_counts_no_loss_while_another_one_is_answered() -> None:
    """Answers go to who asked; numbers that all shared would make the others believe that they had missed some."""
    net = Net("udpin:127.0.0.1:1")
    net.wires[0].peers = ("curious", "patient")
    net.wires[0].take()
    voice = Voice(255)
    net.wires[0].put(voice.frame(mavlink.MAVLink_param_request_list_message(1, 1)), "curious")
    for _ in range(300):
        net.now += 0.02
        net.step()
        net.link.stream(net.now)
    readers: dict[Any, FrameReader] = {}
    numbers: dict[Any, list[int]] = {}
    for sent in net.wires[0].take():
        raw = [frame.raw for frame in readers.setdefault(sent.peer, FrameReader()).feed(sent.data)]
        numbers.setdefault(sent.peer, []).extend(each[4] for each in raw)
    assert set(numbers) == {"curious", "patient"}
    assert len(numbers["curious"]) > len(numbers["patient"]) + 20 > 40
    for said in numbers.values():
        assert [(number - said[0]) % 256 for number in said] == [i % 256 for i in range(len(said))]


THREE = ("udpin:127.0.0.1:1", "udpin:127.0.0.1:2", "tcpin:127.0.0.1:3")


def test_what_is_for_all_goes_to_every_other_link_and_never_back() -> None:
    net = Net(*THREE)
    data = Voice(255).frame(HEARTBEAT)
    assert net.pass_on(0, data) == [[], [data], [data]]
    assert [counts.forwarded for counts in net.link.counts] == [0, 1, 1]


def test_what_is_for_one_goes_where_it_was_heard_and_to_nobody_else() -> None:
    net = Net(*THREE)
    net.pass_on(2, Voice(7, 1).frame(HEARTBEAT))
    station = Voice(255)
    data = station.frame(command(7, 1))
    assert net.pass_on(0, data) == [[], [], [data]]
    anyone = station.frame(command(7, 0))
    assert net.pass_on(0, anyone) == [[], [], [anyone]]
    nobody = station.frame(command(9, 1))
    assert net.pass_on(0, nobody) == [[], [], []]
    other = station.frame(command(7, 50))
    assert net.pass_on(0, other) == [[], [], []]
    assert not net.vehicle.armed


def test_what_is_for_us_stays_and_our_camera_gets_its_own() -> None:
    net = Net(*THREE)
    net.pass_on(1, Voice(1, 100).frame(HEARTBEAT))
    station = Voice(255)
    ours = station.frame(command(1, 1))
    assert net.pass_on(0, ours) == [[], [], []] and net.vehicle.armed
    net.vehicle.armed = False
    camera = station.frame(command(1, 100))
    assert net.pass_on(0, camera) == [[], [camera], []] and not net.vehicle.armed
    both = station.frame(command(1, 0))
    assert net.pass_on(0, both) == [[], [both], []] and net.vehicle.armed


def test_our_own_voice_echoed_by_a_loop_is_neither_answered_nor_passed_on() -> None:
    net = Net(*THREE)
    assert net.pass_on(0, Voice(1, 1).frame(ping())) == [[], [], []]
    assert net.wires[0].welcomed == set()


def test_links_that_meet_elsewhere_make_no_circle() -> None:
    """What comes out of one of two links comes in again at the other, as a simple router there would do."""
    net = Net(*THREE[:2])
    station, passed = Voice(255), 0
    for _ in range(20):
        waiting = [(0, station.frame(HEARTBEAT))]
        for _ in range(10):
            if waiting:
                out = net.pass_on(*waiting.pop())
                passed += sum(map(len, out))
                waiting += [(1 - number, each) for number, came in enumerate(out) for each in came]
        assert not waiting, "a frame circles"
        net.now += 0.1
    assert passed == 20, "each once"


def test_who_is_heard_on_two_links_is_not_told_to_them() -> None:
    net = Net(*THREE)
    station = Voice(255)
    net.pass_on(0, station.frame(HEARTBEAT))
    net.pass_on(1, station.frame(HEARTBEAT))
    data = station.frame(HEARTBEAT)
    assert net.pass_on(0, data) == [[], [], [data]]


def test_a_link_may_keep_out_and_radios_and_keys_are_not_passed_on() -> None:
    net = Net(THREE[0], THREE[1] + "?forward=no", THREE[2])
    data = Voice(255).frame(HEARTBEAT)
    assert net.pass_on(0, data) == [[], [], [data]]
    data = Voice(254).frame(HEARTBEAT)
    assert net.pass_on(1, data) == [[], [], []]
    net.pass_on(2, Voice(7, 1).frame(HEARTBEAT))
    for message in (
        mavlink.MAVLink_radio_status_message(1, 1, 99, 1, 1, 0, 0),
        mavlink.MAVLink_setup_signing_message(7, 1, [1] * 32, 0),
    ):
        assert net.pass_on(0, Voice(51, 68).frame(message)) == [[], [], []]


def test_messages_of_other_dialects_are_passed_on_too() -> None:
    from pymavlink.dialects.v20 import ardupilotmega

    net = Net(*THREE)
    sender = ardupilotmega.MAVLink(None, 255, 190)
    plain = bytes(ardupilotmega.MAVLink_wind_message(1.0, 2.0, 3.0).pack(sender))
    assert mavlink.mavlink_map.get(ardupilotmega.MAVLINK_MSG_ID_WIND) is None
    assert net.pass_on(0, plain) == [[], [plain], [plain]]
    net.pass_on(2, Voice(7, 1).frame(HEARTBEAT))
    aimed = bytes(ardupilotmega.MAVLink_digicam_control_message(7, 1, *[0] * 7, 0.0).pack(sender))
    assert net.pass_on(0, aimed) == [[], [], [aimed]]
    assert net.link.counts[0].unknown == 2


def test_signed_frames_are_passed_on_as_they_are_and_refused_ones_are_not() -> None:
    wires = [Wire(url) for url in THREE[:2]]
    key = bytes(range(32))
    link = GroundLink(wires, FakeVehicle(), files=Files(signing=Signing(lambda: 1.7e9, key)))
    station = mavlink.MAVLink(None, 255, 190)
    station.signing.secret_key, station.signing.sign_outgoing = key, True
    station.signing.timestamp = 30_000_000_000_000
    signed, unsigned = bytes(HEARTBEAT.pack(station)), Voice(254).frame(HEARTBEAT)
    wires[0].put(signed)
    wires[0].put(unsigned)
    link.poll(1.0)
    sent = [each.data for each in wires[1].take()]
    assert signed in sent and unsigned not in sent


def test_a_silent_sender_is_forgotten_and_forged_ones_fill_no_memory() -> None:
    router = Router([True, True], OURS)
    router.hops(frame(HEARTBEAT, 7, 1), 1, "radio", 0.0)
    assert router.hops(frame(command(7, 1), 255), 0, "x", FORGET - 1.0) == [Hop(1, "radio")]
    assert router.hops(frame(command(7, 1), 254), 0, "x", FORGET + 1.0) == []
    for number in range(1000):
        router.hops(frame(HEARTBEAT, 1 + number % 250, number // 250), 0, "x", 100.0 + number)
    assert len(router.known(0)) == MOST_KNOWN


@pytest.mark.parametrize("message", [ping(7, 3), command(7, 3), mavlink.MAVLink_param_request_list_message(7, 3)])
def test_the_target_is_read_where_the_message_has_it(message: Any) -> None:
    assert target_of(frame(message, 255)) == (7, 3)
    assert target_of(frame(HEARTBEAT, 255)) == (0, 0)


def test_each_link_has_its_own_rates_and_its_own_sequence_numbers() -> None:
    net = Net(*THREE)
    attitude = mavlink.MAVLINK_MSG_ID_ATTITUDE
    fast = mavlink.MAVLink_command_long_message(1, 1, 511, 0, attitude, 20000.0, 0, 0, 0, 0, 0)
    net.wires[1].put(Voice(255).frame(fast))
    net.step()
    for each in net.wires:
        each.take()
    for _ in range(1000):
        net.now += 0.004
        net.step()
        net.link.stream(net.now)
    for wire, rate in zip(net.wires, (10, 50, 10), strict=True):
        frames = [FrameReader().feed(sent.data)[0] for sent in wire.take()]
        assert sum(each.message_id == attitude for each in frames) == pytest.approx(4 * rate, abs=0.06 * 4 * rate)
        numbers = [each.raw[4] for each in frames]
        assert all((after - before) % 256 == 1 for before, after in itertools.pairwise(numbers))


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="needs pseudo terminals")
def test_over_udp_tcp_and_a_serial_line_at_once() -> None:
    """A station on a serial line commands a second vehicle on TCP through this one."""
    import socket
    import time

    from link_station import PATIENCE
    from ports import free_port

    udp, tcp = free_port(), free_port(socket.SOCK_STREAM)
    master, slave = os.openpty()
    os.set_blocking(master, False)
    urls = [f"udpin:127.0.0.1:{udp}", f"tcpin:127.0.0.1:{tcp}", f"serial:{os.ttyname(slave)},57600"]
    link = GroundLink(urls, FakeVehicle())
    data = Voice(255).frame(command(7, 1))
    with socket.create_connection(("127.0.0.1", tcp)) as other:
        other.setblocking(False)
        other.sendall(Voice(7, 1).frame(HEARTBEAT))
        got, deadline = b"", time.monotonic() + PATIENCE
        while data not in got and time.monotonic() < deadline:
            link.poll(time.monotonic())
            if link.counts[1].frames and not link.counts[2].frames:
                os.write(master, data)
            try:
                got += other.recv(4096)
            except BlockingIOError:
                continue
    link.close()
    os.close(master)
    os.close(slave)
    assert data in got
