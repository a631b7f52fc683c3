"""What a link's stations may cost, however many they say that they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence

import pytest
from link_vehicle import HOME, FakeVehicle
from link_wires import Voice, Wire

from avionics.guidance.mission import ItemKind, MissionItem
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.services import plans
from avionics.link.services.parameters import MOST_LISTS
from avionics.link.vehicle import Home, LinkGains
from avionics.link.wire_item import WireItem

STEP = 0.004


class Links:
    """A vehicle on some wires, and stations that speak on them."""

    def __init__(self, count: int = 1) -> None:
        self.wires = [Wire(f"udpin:127.0.0.1:{number}") for number in range(1, count + 1)]
        self.vehicle, self.now = FakeVehicle(), 5.0
        self.link = GroundLink(self.wires, self.vehicle)
        self.step()

    def step(self) -> list[Counter[str]]:
        """A moment passes; for each wire how many of each message were sent to each station."""
        self.now += STEP
        self.vehicle.apply(self.link.poll(self.now))
        return [self._values(wire) for wire in self.wires]

    def _values(self, wire: Wire) -> Counter[str]:
        sent = [each for each in wire.take() if each.data[7] == mavlink.MAVLINK_MSG_ID_PARAM_VALUE]
        return Counter(str(each.peer) for each in sent)

    def ask_list(self, wire: int, system: int, name: str = "") -> None:
        self.wires[wire].say(
            Voice(system).frame(mavlink.MAVLink_param_request_list_message(1, 1)), name or str(system)
        )


def test_however_many_ask_for_parameters_a_link_sends_no_more_at_once_than_for_one() -> None:
    links = Links(2)
    for system in range(2, 102):
        links.ask_list(0, system)
    links.ask_list(1, 200)
    each = LinkGains().parameters_per_step
    assert [sum(values.values()) for values in links.step()] == [each, each]


def test_the_oldest_list_makes_room_and_on_another_link_nothing_changes() -> None:
    links = Links(2)
    links.ask_list(1, 200)
    for system in range(2, 2 + MOST_LISTS + 3):
        links.ask_list(0, system)
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
    links.ask_list(0, 10)
    links.ask_list(0, 11)
    links.step()
    links.ask_list(0, 10)
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
        links.wires[0].say(Voice(255).frame(mavlink.MAVLink_mission_request_int_message(1, 1, number)))
    links.link.poll(links.now)
    items = [each for each in links.wires[0].heard() if each.get_type() == "MISSION_ITEM_INT"]
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
