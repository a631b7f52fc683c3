"""What a link's stations may cost, however many they say that they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest
from link_vehicle import HOME, FakeVehicle
from link_wires import Voice, Wire

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.ground import MOST_WORK, WORK_OF_INPUT, GroundLink
from avionics.link.services import plans
from avionics.link.services.parameters import MOST_LISTS
from avionics.link.vehicle import Home, LinkGains
from avionics.link.wire_item import WireItem
from avionics.messages import Command, CommandKind, Input

STEP = 0.004
MOST_AT_THE_END = 24
"""frames of the answer that passes the bound, and of what is due unasked, on three links"""


class Links:
    """A vehicle on some wires, and stations that speak on them."""

    def __init__(self, count: int = 1) -> None:
        self.wires = [Wire(f"udpin:127.0.0.1:{number}") for number in range(1, count + 1)]
        self.vehicle, self.now = FakeVehicle(), 5.0
        self.link = GroundLink(self.wires, self.vehicle)
        self.step()

    def step(self) -> list[Counter[str]]:
        """A moment passes; for each wire how many of each message were sent to each station."""
        self.poll()
        return [self._values(wire) for wire in self.wires]

    def poll(self) -> list[Input]:
        """A moment passes; what enters the flight core."""
        self.now += STEP
        inputs = self.link.poll(self.now)
        self.vehicle.apply(inputs)
        return inputs

    def _values(self, wire: Wire) -> Counter[str]:
        sent = [each for each in wire.take() if each.data[7] == mavlink.MAVLINK_MSG_ID_PARAM_VALUE]
        return Counter(str(each.peer) for each in sent)

    def request_list(self, wire: int, system: int, name: str = "") -> None:
        self.wires[wire].put(
            Voice(system).frame(mavlink.MAVLink_param_request_list_message(1, 1)), name or str(system)
        )


def test_however_many_ask_for_parameters_a_link_sends_no_more_at_once_than_for_one() -> None:
    links = Links(2)
    for system in range(2, 102):
        links.request_list(0, system)
    links.request_list(1, 200)
    each = LinkGains().parameters_per_step
    assert [sum(values.values()) for values in links.step()] == [each, each]


@pytest.mark.parametrize(
    "message",
    [
        mavlink.MAVLink_ping_message(0, 1, 0, 0),
        mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
        mavlink.MAVLink_param_set_message(1, 1, b"PITCH_P", 1.5, 9),
        mavlink.MAVLink_mission_request_list_message(1, 1),
        mavlink.MAVLink_mission_clear_all_message(1, 1),
        mavlink.MAVLink_set_mode_message(1, 1, 1 << 16),
        mavlink.MAVLink_command_long_message(1, 1, 512, 0, mavlink.MAVLINK_MSG_ID_ATTITUDE, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(1, 1, 512, 0, mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_attitude_message(0, 0.1, 0, 0, 0, 0, 0),
    ],
    ids=lambda message: message.get_type(),
)
def test_under_any_flood_a_poll_does_so_much_and_another_link_is_answered(message: Any) -> None:
    """GIVEN two links with hundreds of frames each WHEN another disarms on a third THEN that poll answers it."""
    links, voices = Links(3), [Voice(system) for system in range(2, 250)]
    for number in range(600):
        links.wires[number % 2].put(voices[number % len(voices)].frame(message), f"flood {number % 2}")
    links.wires[0].put(Voice(254).frame(mavlink.MAVLink_timesync_message(0, 7)), "last")
    links.wires[2].put(Voice(255).frame(disarming()), "station")
    assert CommandKind.DISARM in {each.kind for each in links.poll() if isinstance(each, Command)}
    sent = [wire.take() for wire in links.wires]
    assert mavlink.MAVLINK_MSG_ID_COMMAND_ACK in {each.data[7] for each in sent[2]}
    assert sum(map(len, sent)) <= MOST_WORK + MOST_AT_THE_END
    polls, answered = 1, False
    while not answered:
        polls += 1
        assert len(links.poll()) <= 1 + MOST_WORK // WORK_OF_INPUT
        said = [each for wire in links.wires for each in wire.take()]
        assert len(said) <= MOST_WORK + MOST_AT_THE_END
        answered = any(each.peer == "last" and each.data[7] == mavlink.MAVLINK_MSG_ID_TIMESYNC for each in said)
    assert 600 // MOST_WORK <= polls < 150


def disarming() -> Any:
    return mavlink.MAVLink_command_long_message(1, 1, 400, 0, 0, 0, 0, 0, 0, 0, 0)


def test_the_oldest_list_makes_room_and_on_another_link_nothing_changes() -> None:
    links = Links(2)
    links.request_list(1, 200)
    for system in range(2, 2 + MOST_LISTS + 3):
        links.request_list(0, system)
    total = [Counter[str](), Counter[str]()]
    for _ in range(200):
        for sums, values in zip(total, links.step(), strict=True):
            sums.update(values)
    whole = len(links.vehicle.parameters)
    assert total[0] == {str(system): whole for system in range(5, 2 + MOST_LISTS + 3)}
    assert total[1] == {"200": whole}


def test_who_asks_again_keeps_his_place() -> None:
    """GIVEN a station whose list is under way WHEN it asks anew THEN it begins anew, before those who came later."""
    links = Links()
    links.request_list(0, 10)
    links.request_list(0, 11)
    links.step()
    links.request_list(0, 10)
    assert set(links.step()[0]) == {"10"}


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """How many items were encoded, each time that a mission was."""
    calls: list[int] = []
    part = plans._PARTS[mavlink.MAV_MISSION_TYPE_MISSION]

    def counting(encode: Callable[..., tuple[WireItem, ...]]) -> Callable[..., tuple[WireItem, ...]]:
        def counted(mission: Sequence[MissionItem], home: Home | None) -> tuple[WireItem, ...]:
            calls.append(len(mission))
            return encode(mission, home)

        return counted

    monkeypatch.setitem(plans._PARTS, part.mission_type, part._replace(encode=counting(part.encode)))
    yield calls


def places(links: Links, count: int) -> list[tuple[int, float]]:
    """The mission as it is downloaded: latitude and altitude of each item."""
    for number in range(count):
        links.wires[0].put(Voice(255).frame(mavlink.MAVLink_mission_request_int_message(1, 1, number)))
    items: list[Any] = []
    while len(items) < count:  # some in each poll
        links.now += STEP
        links.link.poll(links.now)
        news = [each for each in links.wires[0].incoming() if each.get_type() == "MISSION_ITEM_INT"]
        assert news
        items += news
    return [(each.x, each.z) for each in items]


def test_a_mission_is_encoded_once_for_all_its_items_and_anew_when_it_or_home_changes(encoded: list[int]) -> None:
    links = Links()
    legs = tuple(MissionItem(ItemKind.WAYPOINT, 10.0 * n, 0.0, 40.0) for n in range(1, 41))
    links.vehicle.mission = legs
    first = places(links, 40)
    assert len(first) == 40 and encoded == [40]
    assert places(links, 40) == first and encoded == [40]
    links.vehicle.mission = tuple(leg._replace(altitude=50.0) for leg in legs)
    assert [z for _, z in places(links, 40)] == [50.0] * 40 and encoded == [40, 40]
    links.vehicle.home = HOME._replace(latitude=HOME.latitude + 1e-3)
    moved = places(links, 40)
    assert encoded == [40, 40, 40] and moved[0][0] - first[0][0] == pytest.approx(572958, abs=2)
