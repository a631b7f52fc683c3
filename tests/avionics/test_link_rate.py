"""A slow link: its streams stay within the rate, thinned in the stated order, and nothing that matters is lost."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest
from link_vehicle import FakeVehicle
from link_wires import Sent, Voice, Wire

from avionics.link.budget import DEPTH, SHALLOWEST, TELEMETRY_FRAMES, USED, Budget, Rank
from avionics.link.dialect import mavlink
from avionics.link.framing import FrameReader, decode
from avionics.link.ground import GroundLink
from avionics.link.stream_table import STREAMS
from avionics.link.streams import LONGEST_WAIT
from avionics.link.telemetry import MIRRORS

POLL = 0.004
BAUD = 57_600


class Radio:
    """A vehicle on one slow wire; every stream that there is is asked for at ``rate`` Hz."""

    def __init__(self, url: str, rate: float) -> None:
        self.wire, self.vehicle = Wire(url), FakeVehicle()
        self.link = GroundLink([self.wire], self.vehicle)
        self.now, self.station = 10.0, Voice(255)
        self.sent: list[Sent] = []
        for entry in STREAMS:
            self.send_request(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, entry.message_id, 1e6 / rate)
        self.fly(0.5)
        self.settling, self.sent = self.sent, []

    def send_request(self, command: int, *params: float) -> None:
        padded = (*params, *(0.0,) * (7 - len(params)))
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded))

    def send(self, message: Any) -> None:
        self.wire.put(self.station.frame(message))
        self.fly(POLL)

    def fly(self, duration: float) -> None:
        end = self.now + duration - 1e-9
        while self.now < end:
            self.now += POLL
            self.vehicle.apply(self.link.poll(self.now))
            self.link.stream(self.now)
        self.sent += self.wire.take()

    def messages(self) -> list[tuple[float, Any]]:
        return read(self.sent)

    def counted(self) -> Counter[str]:
        return Counter(message.get_type() for _, message in self.messages())


def read(sent: list[Sent]) -> list[tuple[float, Any]]:
    reader = FrameReader()
    return [(each.time, decode(frame)) for each in sent for frame in reader.feed(each.data)]


def busiest(sent: list[Sent], window: float) -> int:
    """Most bytes sent within ``window`` (s)."""
    return max(sum(len(b.data) for b in sent if 0.0 <= b.time - a.time < window) for a in sent)


@pytest.mark.parametrize("url", ["serial:/dev/null,57600", "udpout:127.0.0.1:9?rate=57600"])
def test_streams_stay_within_the_rate_and_it_is_said_once(url: str) -> None:
    radio = Radio(url, 20.0)
    radio.fly(12.0)
    rate = BAUD / 10.0
    assert busiest(radio.sent, 1.0) <= rate * (1.0 + DEPTH)
    total = sum(len(each.data) for each in radio.sent) / 12.0
    assert 0.9 * USED * rate < total <= USED * rate * (1.0 + DEPTH / 12.0)
    assert radio.counted()["HEARTBEAT"] == 12
    texts = [each for _, each in read(radio.settling + radio.sent) if each.get_type() == "STATUSTEXT"]
    told = [event.text for event in radio.link.take_events() if "reduced" in event.text]
    assert len(told) == 1 and "".join(each.text for each in texts) == told[0]


@pytest.mark.parametrize(("rate", "whole", "rest"), [(20.0, 1, 2), (9.0, 2, 1)])
def test_the_lowest_ranks_are_thinned_first(rate: float, whole: int, rest: int) -> None:
    """The first ``whole`` ranks come as asked, the last ``rest`` now and then."""
    radio = Radio(f"udpout:127.0.0.1:9?rate={BAUD}", rate)
    radio.fly(20.0)
    count = radio.counted()
    count["NAMED_VALUE_FLOAT"] //= len(MIRRORS)
    got: dict[Rank, list[float]] = {rank: [] for rank in Rank}
    for entry in STREAMS:
        got[entry.rank].append(count[mavlink.mavlink_map[entry.message_id].msgname] / (20.0 * rate))
    shares = [sum(got[rank]) / len(got[rank]) for rank in Rank]
    assert shares == sorted(shares, reverse=True)
    assert min(shares[:whole]) > 0.9 and max(shares[-rest:]) < 0.2
    assert all(share >= 3.0 / (20.0 * rate) for rank in Rank for share in got[rank]), "a stream is never sent"


def test_a_fast_link_is_not_thinned() -> None:
    radio = Radio("udpout:127.0.0.1:9", 20.0)
    radio.fly(5.0)
    assert radio.counted()["SERVO_OUTPUT_RAW"] == pytest.approx(100, abs=8)
    assert not [event for event in radio.link.take_events() if "reduced" in event.text]


def test_commands_parameters_and_missions_come_through_a_full_link_at_once() -> None:
    radio = Radio(f"udpout:127.0.0.1:9?rate={BAUD}", 50.0)
    radio.fly(2.0)
    begin = radio.now
    radio.send_request(mavlink.MAV_CMD_NAV_LAND)
    radio.send(mavlink.MAVLink_param_request_list_message(1, 1))
    radio.send(mavlink.MAVLink_mission_count_message(1, 1, 1))
    radio.send(mavlink.MAVLink_param_set_message(1, 1, b"PITCH_P", 1.5, 9))
    radio.fly(3.0)
    times: dict[str, list[float]] = {}
    for time, message in radio.messages():
        if time >= begin:
            times.setdefault(message.get_type(), []).append(time - begin)
    assert times["COMMAND_ACK"][0] < 0.02 and times["MISSION_REQUEST_INT"][0] < 0.03
    assert len(times["PARAM_VALUE"]) == len(radio.vehicle.parameters) + 1
    whole = len(radio.vehicle.parameters) * 37 / (BAUD / 10)
    assert times["PARAM_VALUE"][-1] < 1.5 * whole
    late = [sent for sent in radio.sent if sent.time > begin]
    assert busiest(late, 1.0) <= BAUD / 10.0 * (1.0 + DEPTH)


def test_a_flood_of_requests_is_cut_off_and_the_heartbeat_is_not() -> None:
    radio = Radio("udpout:127.0.0.1:9?rate=1200", 1.0)
    ping = mavlink.MAVLink_ping_message(0, 1, 0, 0)
    begin = radio.now
    for _ in range(1500):
        radio.send(ping)
    elapsed = radio.now - begin
    assert radio.counted()["HEARTBEAT"] >= int(elapsed) - 1
    assert sum(len(each.data) for each in radio.sent) < 120.0 * (elapsed + 3.0) + SHALLOWEST
    assert radio.link.counts[0].dropped > 1000


def test_a_radio_with_a_full_buffer_slows_the_link_and_an_empty_one_frees_it() -> None:
    radio = Radio(f"udpout:127.0.0.1:9?rate={BAUD}", 20.0)

    def rate_with(free: int) -> float:
        for _ in range(10):
            radio.send(mavlink.MAVLink_radio_status_message(200, 200, free, 20, 20, 0, 0))
            radio.fly(0.3)
        radio.sent = []
        radio.fly(2.0)
        return sum(len(each.data) for each in radio.sent) / 2.0

    full, slowed = rate_with(95), rate_with(10)
    assert slowed < 0.2 * full
    assert rate_with(99) > 2.0 * slowed
    rate_with(5)
    radio.fly(8.0)  # the radio is gone: what it said holds no longer
    radio.sent = []
    radio.fly(2.0)
    assert sum(len(each.data) for each in radio.sent) / 2.0 == pytest.approx(full, rel=0.1)


def test_a_radio_on_a_link_without_a_rate_sets_one() -> None:
    radio = Radio("udpout:127.0.0.1:9", 20.0)
    radio.fly(4.0)
    before = sum(len(each.data) for each in radio.sent) / 4.0
    for _ in range(8):
        radio.send(mavlink.MAVLink_radio_status_message(200, 200, 10, 20, 20, 0, 0))
        radio.fly(0.3)
    radio.sent = []
    radio.fly(2.0)
    assert sum(len(each.data) for each in radio.sent) / 2.0 < 0.4 * before


def test_what_other_links_send_waits_for_room() -> None:
    wires = [Wire("udpin:127.0.0.1:1"), Wire("udpin:127.0.0.1:2?rate=1200")]
    link, other = GroundLink(wires, FakeVehicle()), Voice(7, 1)
    now = 0.0
    for _ in range(1000):
        now += POLL
        wires[0].put(other.frame(mavlink.MAVLink_attitude_message(0, 0.1, 0, 0, 0, 0, 0)))
        link.poll(now)
        link.stream(now)
    counts = link.counts[1]
    assert counts.withheld > 900 and counts.forwarded > 0
    assert sum(len(each.data) for each in wires[1].take()) <= 120.0 * now + SHALLOWEST + 280.0
    beats = [each for each in wires[0].incoming() if each.get_type() == "HEARTBEAT"]
    assert len(beats) >= 4


def test_without_a_rate_there_is_always_room() -> None:
    free, slow = Budget(0), Budget(BAUD)
    for budget in (free, slow):
        budget.advance(0.0)
        budget.spend(10_000_000)
    assert (
        free.available_bytes(Rank.LAST.value) > 0.0 > slow.available_bytes(0.0) and slow.broke() and not free.broke()
    )


# --- all links together --------------------------------------------------------------------------------------

PEERS = 16
NAMES = {str(mavlink.mavlink_map[entry.message_id].msgname): entry for entry in STREAMS}
PER_STREAM = {name: len(MIRRORS) if name == "NAMED_VALUE_FLOAT" else 1 for name in NAMES}


class Crowd:
    """A vehicle on links with some peers each; ``fly`` counts the telemetry of each tick."""

    def __init__(self, *peers: int, tick: float = 0.02) -> None:
        self.tick = tick
        self.wires = [Wire(f"udpin:127.0.0.1:{number}") for number in range(1, len(peers) + 1)]
        for wire, count in zip(self.wires, peers, strict=True):
            wire.peers = tuple(range(count))
        self.link, self.now = GroundLink(self.wires, FakeVehicle()), 10.0
        self.received: list[Counter[tuple[str, Any]]] = [Counter() for _ in peers]
        self.most = 0
        self.texts: list[str] = []

    def request(self, wire: int, rate: float) -> None:
        """Every peer of a link requests every stream at ``rate`` Hz."""
        station = Voice(255)
        for peer in self.wires[wire].peers or ():
            for entry in STREAMS:
                message = mavlink.MAVLink_command_long_message(
                    1, 1, 511, 0, entry.message_id, 1e6 / rate, 0, 0, 0, 0, 0
                )
                self.wires[wire].put(station.frame(message), peer)
        while self.link.poll(self.now) or any(wire.take() for wire in self.wires):
            self.now += self.tick

    def fly(self, duration: float) -> None:
        end = self.now + duration - 1e-9
        while self.now < end:
            self.now += self.tick
            self.link.poll(self.now)
            self._count()
            self.link.stream(self.now)
            self.most = max(self.most, self._count())
        self.texts += [event.text for event in self.link.take_events()]

    def _count(self) -> int:
        total = 0
        for wire, received in zip(self.wires, self.received, strict=True):
            sent = wire.take()
            total += len(sent)
            received.update(
                (mavlink.mavlink_map[each.data[7] + (each.data[8] << 8)].msgname, each.peer) for each in sent
            )
        return total

    def rates(self, wire: int, peer: Any, duration: float) -> dict[str, float]:
        """Hz of each stream at one peer."""
        return {name: self.received[wire][name, peer] / PER_STREAM[name] / duration for name in NAMES}


@pytest.mark.parametrize("peers", [(PEERS,), (1,) * PEERS, (8, 8)])
def test_telemetry_has_a_budget_per_tick_over_all_peers_and_links(peers: tuple[int, ...]) -> None:
    """GIVEN sixteen peers that request every stream at 1000 Hz THEN a tick sends so much, lowest ranks last."""
    crowd = Crowd(*peers)
    for wire in range(len(peers)):
        crowd.request(wire, 1000.0)
    crowd.fly(1.0)
    crowd.received, duration = [Counter() for _ in peers], 12.0
    crowd.fly(duration)
    assert crowd.most < TELEMETRY_FRAMES + max(peers) * len(MIRRORS)
    first = [crowd.rates(0, peer, duration) for peer in crowd.wires[0].peers or ()]
    assert all(rates == first[0] for rates in first), "every peer receives the same"
    for wire in range(len(peers)):
        rates = crowd.rates(wire, 0, duration)
        by_rank = [[rate for name, rate in rates.items() if NAMES[name].rank is rank] for rank in Rank]
        assert min(by_rank[0]) > 10.0, by_rank
        assert max(rate for ranked in by_rank[1:] for rate in ranked) < 1.0
        least = int(duration / (LONGEST_WAIT + 1.0)) / duration
        assert all(rate >= least for ranked in by_rank for rate in ranked), "a stream is never sent"
    assert crowd.received[0]["HEARTBEAT", 0] >= duration - 1.0
    limited = [text for text in crowd.texts if "frames per tick" in text]
    assert limited == [f"telemetry exceeds {TELEMETRY_FRAMES} frames per tick: low-priority streams reduced"]


def test_a_link_with_usual_rates_is_not_thinned_by_another() -> None:
    """GIVEN a link whose peers request everything THEN a station on another link has what it has alone."""
    alone, crowd = Crowd(1, tick=0.005), Crowd(PEERS, 1, tick=0.005)
    crowd.request(0, 1000.0)
    for each in (alone, crowd):
        each.fly(1.0)
        each.received = [Counter() for _ in each.wires]
        each.fly(5.0)
    expected, rates = alone.rates(0, 0, 5.0), crowd.rates(1, 0, 5.0)
    assert all(rates[name] == pytest.approx(expected[name], abs=0.41) for name in NAMES), rates
    assert [text for text in alone.texts if "reduced" in text] == []


def test_sixteen_peers_with_usual_rates_are_not_thinned() -> None:
    crowd = Crowd(PEERS, tick=0.005)
    crowd.fly(5.0)
    assert crowd.received[0]["ATTITUDE", 0] == pytest.approx(50, abs=2)
    assert [text for text in crowd.texts if "reduced" in text] == []
