"""A bad radio, on a simulated clock: missions and parameters arrive whole; a cut link comes back by itself."""

from __future__ import annotations

import random
from collections.abc import Iterator
from typing import Any

import pytest
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire
from surrogate import Bird
from surrogate_gains import VEHICLE

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.ground import GroundLink
from avionics.link.vehicle import LinkGains
from avionics.messages import Command, CommandKind, Failsafe, Mode
from avionics.missions import load_mission
from avionics.topics import HEALTH
from avionics.view import FlightView

STEP = 0.02
LOSS, DUPLICATES, DELAY = 0.3, 0.1, 0.3
ASK_AGAIN = 0.8
LONGEST = 600.0


class BadRadio:
    """Both ways between a vehicle and a station, with loss, duplicates and delay."""

    def __init__(self, vehicle: FakeVehicle, seed: int) -> None:
        self.random, self.vehicle, self.now = random.Random(seed), vehicle, 50.0
        self.wire, self.station, self.reader = Wire("udpin:127.0.0.1:1"), Voice(255), FrameReader()
        self.link = GroundLink([self.wire], vehicle)
        self.up: list[tuple[float, bytes]] = []
        self.down: list[tuple[float, bytes]] = []

    def _throw(self, data: bytes, into: list[tuple[float, bytes]]) -> None:
        if self.random.random() >= LOSS:
            into += [(self.now + DELAY, data)] * (2 if self.random.random() < DUPLICATES else 1)

    def send(self, message: Any) -> None:
        self._throw(self.station.frame(message), self.up)

    def step(self) -> list[Any]:
        """Let a moment pass; what the station hears in it."""
        self.now += STEP
        for due, data in self.up:
            if due <= self.now:
                self.wire.put(data)
        self.up = [each for each in self.up if each[0] > self.now]
        self.vehicle.apply(self.link.poll(self.now))
        for sent in self.wire.take():
            self._throw(sent.data, self.down)
        arrived = [data for due, data in self.down if due <= self.now]
        self.down = [each for each in self.down if each[0] > self.now]
        return [decode(frame) for data in arrived for frame in self.reader.feed(data)]

    def received(self) -> Iterator[Any]:
        """What the station hears, and None now and then, for as long as a test may take."""
        while self.now < 50.0 + LONGEST:
            yield from self.step()
            yield None
        raise AssertionError("it never ended")


class Asker:
    """Repeats what is not answered."""

    def __init__(self, radio: BadRadio) -> None:
        self.radio, self.requested = radio, -1e9

    def request(self, message: Any, again: bool = False) -> None:
        if again or self.radio.now - self.requested >= ASK_AGAIN:
            self.requested = self.radio.now
            self.radio.send(message)


def parameters(radio: BadRadio) -> dict[str, float]:
    values: dict[int, tuple[str, float]] = {}
    asker, total = Asker(radio), None
    for message in radio.received():
        if message is not None and message.get_type() == "PARAM_VALUE":
            values[message.param_index] = (message.param_id, message.param_value)
            total, asker.requested = message.param_count, radio.now
        if total is not None and len(values) == total:
            return dict(values.values())
        missing = next((number for number in range(total or 0) if number not in values), None)
        if missing is None:
            asker.request(mavlink.MAVLink_param_request_list_message(1, 1))
        else:
            asker.request(mavlink.MAVLink_param_request_read_message(1, 1, b"", missing))
    raise AssertionError


def download(radio: BadRadio) -> list[Any]:
    items: list[Any] = []
    asker, total = Asker(radio), None
    for message in radio.received():
        kind = "" if message is None else message.get_type()
        if kind == "MISSION_COUNT":
            total = message.count
        news = kind == "MISSION_ITEM_INT" and message.seq == len(items)
        if news:
            items.append(message)
        if total is not None and len(items) == total:
            return items
        if total is None:
            asker.request(mavlink.MAVLink_mission_request_list_message(1, 1))
        else:
            asker.request(mavlink.MAVLink_mission_request_int_message(1, 1, len(items)), again=news)
    raise AssertionError


def upload(radio: BadRadio, items: list[Any]) -> int:
    """The vehicle asks for what it lacks; we repeat the count, and the last item: its answer gets lost."""
    asker, begun, last = Asker(radio), False, False
    for message in radio.received():
        kind = "" if message is None else message.get_type()
        if kind == "MISSION_ACK":
            return int(message.type)
        if kind == "MISSION_REQUEST_INT":
            begun, last = True, message.seq == len(items) - 1
            asker.requested = radio.now
            radio.send(items[message.seq])
        elif not begun:
            asker.request(mavlink.MAVLink_mission_count_message(1, 1, len(items)))
        elif last:
            asker.request(items[-1])
    raise AssertionError


MISSION = (
    MissionItem(ItemKind.TAKEOFF, altitude=40.0),
    *(MissionItem(ItemKind.WAYPOINT, 30.0 * number, -10.0 * number, 40.0 + number) for number in range(30)),
    MissionItem(ItemKind.RETURN),
)


@pytest.mark.parametrize("seed", range(4))
def test_parameters_and_missions_arrive_whole_over_a_bad_radio(seed: int) -> None:
    vehicle = FakeVehicle()
    vehicle.mission = MISSION
    radio = BadRadio(vehicle, seed)
    assert parameters(radio) == {each.name: pytest.approx(each.value) for each in vehicle.parameters}
    items = download(radio)
    assert [item.seq for item in items] == list(range(len(MISSION)))
    vehicle.mission = ()
    for item in items:
        item.target_system = item.target_component = 1
    assert upload(radio, items) == mavlink.MAV_MISSION_ACCEPTED
    assert [each.kind for each in vehicle.mission] == [each.kind for each in MISSION]
    for got, sent in zip(vehicle.mission, MISSION, strict=True):
        assert got[1:4] == pytest.approx(sent[1:4], abs=0.02)


def test_a_station_that_left_in_the_middle_of_an_upload_makes_room_for_another() -> None:
    wire, vehicle = Wire("udpin:127.0.0.1:1"), FakeVehicle()
    link = GroundLink([wire], vehicle)
    count = mavlink.MAVLink_mission_count_message(1, 1, 3)

    def answers(now: float, sender: Voice | None) -> list[str]:
        if sender is not None:
            wire.put(sender.frame(count))
        link.poll(now)
        return [each.get_type() for each in wire.incoming() if each.get_type().startswith("MISSION_")]

    first, second = Voice(255), Voice(254)
    assert answers(0.0, first) == ["MISSION_REQUEST_INT"]
    assert answers(0.5, second) == ["MISSION_ACK"], "denied while the first is heard of"
    later = [answers(float(now), None) for now in range(2, 6)]
    assert later == [["MISSION_REQUEST"], ["MISSION_REQUEST_INT"]] * 2, "an old station knows the first alone"
    assert answers(6.0, second)[0] == "MISSION_REQUEST_INT"


# --- the link cut --------------------------------------------------------------------------------------------


class Flight:
    """The real flight computer and the stand-in bird, a wire to the ground, and a station that may be cut off."""

    def __init__(self) -> None:
        self.view = FlightView(VEHICLE, load_mission("circuit"), lambda topic, message: None)
        self.bird, self.wire, self.station = Bird(), Wire("udpin:127.0.0.1:1"), Voice(255)
        self.link = GroundLink([self.wire], self.view, gains=LinkGains())
        self.tick, self.ticks, self.cut = 0, 0, False
        self.observed: list[Any] = []
        self.inputs: list[Any] = []
        self.beaten = -1.0

    @property
    def now(self) -> float:
        return self.tick / 200.0

    def fly(self, duration: float, script: tuple[Command, ...] = ()) -> None:
        inputs: list[Any] = list(script)
        for _ in range(round(duration * 200)):
            self.tick += 1
            self.bird.advance(self.view.autopilot.step(self.bird.frame(), inputs))
            inputs = self.link.poll(self.now)
            self.inputs += inputs
            self.link.stream(self.now)
            self._radio()

    def _radio(self) -> None:
        if not self.cut and self.now - self.beaten >= 1.0:
            self.beaten = self.now
            self.wire.put(self.station.frame(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
        received = self.wire.take()
        if not self.cut:
            reader = FrameReader()
            self.observed += [decode(frame) for sent in received for frame in reader.feed(sent.data)]

    @property
    def failsafe(self) -> int:
        return int(self.view.latest(HEALTH).failsafe)


def test_a_link_cut_for_a_minute_brings_the_bird_home_and_comes_back_without_a_restart() -> None:
    flight = Flight()
    flight.fly(3.0)
    flight.fly(0.5, (Command(0, CommandKind.SET_MODE, "AUTO"),))
    flight.fly(0.5, (Command(0, CommandKind.ARM),))
    flight.bird.throw()
    flight.fly(12.0)
    assert flight.view.mode is Mode.AUTO and not flight.failsafe & Failsafe.LINK_LOST
    flight.cut = True
    flight.fly(60.0)
    assert CommandKind.LINK_LOST in [each.kind for each in flight.inputs]
    assert flight.failsafe & Failsafe.LINK_LOST and flight.view.mode in (Mode.RETURN, Mode.LAND, Mode.LOITER)
    assert flight.link.stations == 0
    flight.cut, flight.observed = False, []
    flight.fly(2.0)
    assert flight.inputs[-1].kind is CommandKind.LINK_REGAINED
    assert not flight.failsafe & Failsafe.LINK_LOST and flight.link.stations == 1
    assert {"HEARTBEAT", "ATTITUDE"} <= {each.get_type() for each in flight.observed}
    loiter = mavlink.MAVLink_command_long_message(1, 1, mavlink.MAV_CMD_NAV_LOITER_UNLIM, 0, 0, 0, 0, 0, 0, 0, 0)
    flight.wire.put(flight.station.frame(loiter))
    flight.fly(0.5)
    acks = [each for each in flight.observed if each.get_type() == "COMMAND_ACK"]
    assert [ack.result for ack in acks] == [mavlink.MAV_RESULT_ACCEPTED] and flight.view.mode is Mode.LOITER
    assert flight.view.latest(HEALTH).ticks >= flight.tick - 200
