"""Fault isolation: the guard itself, and an exception injected into every service of a link in turn."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from link_vehicle import FakeVehicle
from link_wires import Voice, Wire

from avionics.isolation import (
    BACKOFF,
    MAX_FRAMES,
    MAX_RESTARTS,
    STABLE,
    FaultCode,
    Guard,
    Isolation,
    ServiceFault,
    fault_events,
)
from avionics.link.dialect import mavlink
from avionics.link.ground import GroundLink
from avionics.link.sensor_codec import TELEMETRY
from avionics.link.stream_table import STREAMS
from wingbeat.message import Event, Severity

POLL = 0.02
"""s; between two ticks that serve the links"""
OPTIONAL = {sensor.wire for sensor in TELEMETRY}
"""messages of sensors that this vehicle does not carry"""
NAMES = {
    name: entry for entry in STREAMS if (name := str(mavlink.mavlink_map[entry.message_id].msgname)) not in OPTIONAL
}


class Injected(Exception):
    """What no service raises by itself."""


def fail(*args: Any, **options: Any) -> Any:
    raise Injected("on purpose")


def faults_of(guard: Guard, isolation: Isolation, now: float) -> list[ServiceFault]:
    isolation.advance(now)
    guard.run(fail)
    return isolation.take_faults()


# --- the guard -----------------------------------------------------------------------------------------------


def test_a_call_gives_its_result_and_after_a_fault_none_until_the_restart() -> None:
    isolation, restarted = Isolation(), []
    guard = isolation.guard("survey", lambda: restarted.append(isolation.now))
    isolation.advance(100.0)
    assert guard.run(divmod, 7, 2) == (3, 1)
    assert guard.run(fail) is None and guard.run(divmod, 7, 2) is None
    isolation.advance(100.0 + 0.99 * BACKOFF)
    assert guard.run(divmod, 7, 2) is None
    isolation.advance(100.0 + BACKOFF)
    assert guard.run(divmod, 7, 2) == (3, 1) and restarted == [100.0 + BACKOFF]


def test_the_backoff_doubles_and_the_service_is_disabled_after_the_last_restart() -> None:
    isolation, now, retries = Isolation(), 0.0, []
    guard = isolation.guard("survey")
    for number in range(MAX_RESTARTS + 1):
        (fault,) = faults_of(guard, isolation, now)
        assert (fault.service, fault.faults) == ("survey", number + 1)
        retries.append(fault.retry)
        now += fault.retry if math.isfinite(fault.retry) else 1e6
    assert retries == [BACKOFF * 2.0**number for number in range(MAX_RESTARTS)] + [math.inf]
    assert fault.code is FaultCode.DISABLED
    assert faults_of(guard, isolation, now) == [] and not guard.enabled


def test_a_vital_service_is_restarted_without_end() -> None:
    isolation, now = Isolation(), 0.0
    guard = isolation.guard("heartbeat", vital=True)
    for _ in range(4 * MAX_RESTARTS):
        (fault,) = faults_of(guard, isolation, now)
        assert fault.code is FaultCode.RESTART
        now += fault.retry
    assert fault.retry == BACKOFF * 2.0 ** (MAX_RESTARTS - 1)


def test_restarts_are_counted_anew_after_a_time_without_a_fault() -> None:
    isolation = Isolation()
    guard = isolation.guard("survey")
    for number in range(3 * MAX_RESTARTS):
        (fault,) = faults_of(guard, isolation, number * (STABLE + 1.0))
        assert fault.retry == BACKOFF and fault.faults == number + 1


def test_a_restart_that_raises_is_a_fault_of_its_service() -> None:
    isolation = Isolation()
    guard = isolation.guard("survey", fail)
    faults_of(guard, isolation, 0.0)
    isolation.advance(BACKOFF)
    assert [fault.faults for fault in isolation.take_faults()] == [2] and not guard.enabled


def test_a_traceback_is_logged_once_and_cut_and_can_be_encoded() -> None:
    isolation = Isolation()
    guard = isolation.guard("survey", backoff=0.0)

    def recurse(depth: int) -> None:
        (recurse if depth % 2 else again)(depth + 1)

    def again(depth: int) -> None:
        recurse(depth)

    faults = []
    for _ in range(2):
        isolation.advance(0.0)
        guard.run(open, "\udcfc\x00")
        guard.run(recurse, 0)
        faults += isolation.take_faults()
    first, second = faults
    assert first.traceback.startswith("Traceback") and second.traceback == ""
    assert [event.severity for event in fault_events(first, 5)] == [Severity.ERROR, Severity.DEBUG]
    assert [event.severity for event in fault_events(second, 5)] == [Severity.ERROR]
    isolation.advance(0.0)
    guard.run(recurse, 0)
    (deep,) = isolation.take_faults()
    assert deep.error.startswith("RecursionError") and deep.traceback.count("  File ") <= MAX_FRAMES
    for fault in (first, deep):
        (event, detail) = fault_events(fault, 5)
        assert "\n" not in event.text and event.text.encode() and detail.text.encode()
        head, _, trace = detail.text.partition("\n")
        assert json.loads(head) == {
            "code": "restart", "service": "survey", "faults": fault.faults, "retry_s": 0.0
        } and trace == fault.traceback  # fmt: skip


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit])
def test_what_ends_the_program_passes(interruption: type[BaseException]) -> None:
    def end() -> None:
        raise interruption

    with pytest.raises(interruption):
        Isolation().guard("survey").run(end)


# --- every service of a link ---------------------------------------------------------------------------------


class Links:
    """A vehicle on two wires with a station on each; ``poll`` is a tick's service of the links."""

    def __init__(self) -> None:
        self.wires = [Wire("udpin:127.0.0.1:1"), Wire("udpin:127.0.0.1:2")]
        self.vehicle, self.now = FakeVehicle(), 10.0
        self.link = GroundLink(self.wires, self.vehicle)
        self.voices = [Voice(255), Voice(254)]
        self.events: list[Event] = []
        self.received: list[list[Any]] = [[], []]

    def send(self, message: Any) -> None:
        for wire, voice in zip(self.wires, self.voices, strict=True):
            wire.put(voice.frame(message))

    def fly(self, duration: float) -> None:
        end = self.now + duration - 1e-9
        while self.now < end:
            self.now += POLL
            self.vehicle.apply(self.link.poll(self.now))
            self.link.stream(self.now)
            self.events += self.link.take_events()
        for received, wire in zip(self.received, self.wires, strict=True):
            received += wire.incoming()

    def texts(self, wire: int = 1) -> str:
        """What the station on a wire was sent as STATUSTEXT; ends with the chunks of the last."""
        return "".join(each.text for each in self.received[wire] if each.get_type() == "STATUSTEXT")

    def kinds(self, wire: int = 1) -> set[str]:
        kinds = {each.get_type() for each in self.received[wire]}
        self.received[wire] = []
        return kinds


HEARTBEAT = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
SERVICES = tuple(GroundLink([Wire("udpin:127.0.0.1:1")], FakeVehicle())._services)
MESSAGES = {
    "HEARTBEAT": HEARTBEAT,
    "COMMAND_LONG": mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0),
    "PARAM_REQUEST_LIST": mavlink.MAVLink_param_request_list_message(1, 1),
    "MISSION_REQUEST_LIST": mavlink.MAVLink_mission_request_list_message(1, 1),
    "SET_MODE": mavlink.MAVLink_set_mode_message(1, 1, 1 << 16),
    "REQUEST_DATA_STREAM": mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1),
    "TIMESYNC": mavlink.MAVLink_timesync_message(0, 1),
    "FILE_TRANSFER_PROTOCOL": mavlink.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251),
    "MANUAL_CONTROL": mavlink.MAVLink_manual_control_message(1, 500, 500, 500, 500, 0),
    "SETUP_SIGNING": mavlink.MAVLink_setup_signing_message(1, 1, list(range(32)), 1),
    "SET_ATTITUDE_TARGET": mavlink.MAVLink_set_attitude_target_message(
        0, 1, 1, 7, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0.5
    ),
    "LOG_REQUEST_LIST": mavlink.MAVLink_log_request_list_message(1, 1, 0, 0xFFFF),
    "RADIO_STATUS": mavlink.MAVLink_radio_status_message(200, 200, 90, 20, 20, 0, 0),
}


def assert_reported_once(links: Links, service: str) -> None:
    """One line to the ground and to the log, the traceback to the log alone."""
    errors = [event for event in links.events if event.source == service and event.severity is Severity.ERROR]
    traces = [event for event in links.events if event.source == service and event.severity is Severity.DEBUG]
    assert len(errors) == 1 and errors[0].text.endswith("Injected: on purpose") and "\n" not in errors[0].text
    assert len(traces) == 1 and "Traceback" in traces[0].text and json.loads(traces[0].text.partition("\n")[0])
    assert errors[0].text in links.texts() and "Traceback" not in links.texts()
    assert errors[0] in links.link.announced and traces[0] not in links.link.announced


@pytest.mark.parametrize("method", ["step", "receive"])
@pytest.mark.parametrize("service", SERVICES)
def test_a_service_that_raises_is_reported_and_restarted(
    service: str, method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN any service WHEN it raises THEN the others go on, the fault is reported, and it works again later."""
    links = Links()
    hosted = links.link._services[service]
    taken = [MESSAGES[name] for name in sorted(hosted.service.takes) if name in MESSAGES]
    if method == "receive" and not taken:
        assert service in ("status text", "flight information", "modes")  # they take no message
        return
    links.fly(1.0)
    normal = getattr(hosted.service, method)
    monkeypatch.setattr(hosted.service, method, fail)
    for message in taken:
        links.send(message)
    links.fly(0.5)
    assert not hosted.guard.enabled
    links.received = [[], []]
    others = {name: each for name, each in links.link._services.items() if name != service}
    assert all(each.guard.enabled for each in others.values())
    setattr(hosted.service, method, normal)
    links.events, announced = [], list(links.link.announced)
    links.fly(2.0 * BACKOFF)
    assert hosted.guard.enabled and links.events == [] and links.link.announced == announced
    assert {"ATTITUDE", "HEARTBEAT"} <= links.kinds()


@pytest.mark.parametrize("service", SERVICES)
def test_the_fault_of_a_service_reaches_the_ground_and_the_log_once(
    service: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    links = Links()
    links.fly(1.0)
    hosted = links.link._services[service]
    before = hosted.service.step

    def fail_once(now: float) -> Any:
        monkeypatch.setattr(hosted.service, "step", before)
        return fail()

    monkeypatch.setattr(hosted.service, "step", fail_once)
    links.fly(2.0 * BACKOFF)
    assert_reported_once(links, service)


@pytest.mark.parametrize("name", NAMES)
def test_a_telemetry_builder_that_raises_costs_its_own_message(name: str) -> None:
    links, entry = Links(), NAMES[name]
    for each in STREAMS:
        links.send(mavlink.MAVLink_command_long_message(1, 1, 511, 0, each.message_id, 2e5, 0, 0, 0, 0, 0))
    links.fly(1.0)
    assert set(NAMES) <= links.kinds()
    for schedules in links.link._streams._links:
        schedule = schedules[entry.message_id]
        schedule.entry = schedule.entry._replace(build=fail)
    links.fly(0.5 * BACKOFF)
    assert_reported_once(links, f"telemetry {name}")
    links.kinds()
    links.fly(0.4 * BACKOFF)
    assert set(NAMES) - links.kinds() == {name}
    for schedules in links.link._streams._links:
        schedules[entry.message_id].entry = entry
    links.fly(BACKOFF)
    assert name in links.kinds()


@pytest.mark.parametrize("method", ["receive", "send"])
def test_a_link_that_raises_leaves_the_other_links(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    links = Links()
    links.fly(1.0)
    monkeypatch.setattr(links.wires[0], method, fail)
    links.fly(0.5 * BACKOFF)
    assert_reported_once(links, "link udpin:127.0.0.1:1")
    links.kinds()
    links.send(MESSAGES["TIMESYNC"])
    links.fly(0.2 * BACKOFF)
    assert "TIMESYNC" in links.kinds()
    monkeypatch.undo()
    links.fly(BACKOFF)
    links.received = [[], []]
    links.send(MESSAGES["TIMESYNC"])
    links.fly(0.1)
    assert "TIMESYNC" in links.kinds(0)


@pytest.mark.parametrize(
    ("part", "method", "service"),
    [("_router", "hops", "routing"), ("_streams", "send_due", "telemetry"), ("_signing", "close", "signing setup")],
)
def test_what_is_no_service_is_isolated_too(
    part: str, method: str, service: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    links = Links()
    links.fly(1.0)
    monkeypatch.setattr(getattr(links.link, part), method, fail)
    links.send(MESSAGES["TIMESYNC"])
    links.fly(0.5 * BACKOFF)
    assert "TIMESYNC" in {each.get_type() for each in links.received[1]}
    links.link.close()
    links.events += links.link.take_events()
    assert [event.source for event in links.events if event.severity is Severity.ERROR] == [service]


def test_a_message_that_cannot_be_packed_is_its_senders_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a service that gives a message with a field out of range THEN it is disabled, and no link is."""
    links = Links()
    hosted = links.link._services["time synchronization"]
    wrong = mavlink.MAVLink_timesync_message(1 << 80, 0)
    from avionics.link.services.service import Reply

    monkeypatch.setattr(hosted.service, "receive", lambda message, sender, now: [Reply(wrong, sender)])
    links.send(MESSAGES["TIMESYNC"])
    links.fly(0.1)
    assert not hosted.guard.enabled and all(link.guard.enabled for link in links.link._links)
