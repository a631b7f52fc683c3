"""The client's conversations against a scripted vehicle on a perfect, a lossy and a dead link."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from lossy_vehicle import LossyVehicle, converse

from avionics.link.dialect import mavlink
from groundstation.link import commands, exchange, missions, mode_change, parameters

TARGET = exchange.Target()
LOSSES = pytest.mark.parametrize("loss", [0.0, 0.3])
SEEDS = pytest.mark.parametrize("seed", [1, 2, 3])


@LOSSES
@SEEDS
def test_parameter_download_is_complete(loss: float, seed: int) -> None:
    vehicle = LossyVehicle(loss, seed)
    download = converse(parameters.ParameterDownload(TARGET), vehicle)
    assert not download.failure
    assert {p.name: p.value for p in download.values.values()} == vehicle.values


def test_a_perfect_link_needs_one_request() -> None:
    vehicle = LossyVehicle()
    converse(parameters.ParameterDownload(TARGET), vehicle)
    assert vehicle.requests == ["PARAM_REQUEST_LIST"]


def test_retrying_is_said_with_the_counts() -> None:
    vehicle = LossyVehicle(0.5, seed=4)
    notes: set[str] = set()

    exchange = parameters.ParameterDownload(TARGET)
    now = 0.0
    inbox: list[object] = []
    while not exchange.finished:
        now += 0.05
        outgoing = []
        for message in [message for message in inbox if not vehicle.lost()]:
            exchange, sent = exchange.step(now, message)
            outgoing += sent
        exchange, sent = exchange.step(now, None)
        outgoing += sent
        notes.add(exchange.progress().note)
        inbox = [answer for message in outgoing for answer in vehicle.answers(message)]
    assert any(note.startswith("got ") and note.endswith(" of 40 parameters, retrying") for note in notes)


def test_silence_in_the_middle_says_how_far_it_got() -> None:
    exchange = parameters.ParameterDownload(TARGET)
    exchange, _ = exchange.step(0.0, None)
    value = mavlink.MAVLink_param_value_message(b"GAIN", 1.0, 9, 120, 7)
    exchange, _ = exchange.step(0.1, value)
    for tenth in range(2, 200):
        exchange, _ = exchange.step(tenth / 10, None)
    assert exchange.failure == "got 1 of 120 parameters, then timed out"


@pytest.mark.parametrize(
    "exchange",
    [
        parameters.ParameterDownload(TARGET),
        parameters.ParameterRead(TARGET, "GAIN"),
        parameters.ParameterWrite(TARGET, parameters.Parameter("GAIN", 1.0, 9, 0), 2.0),
        missions.MissionDownload(TARGET),
        missions.MissionUpload(TARGET, (missions.Item(3, 16, (0, 0, 0, 0), 1, 2, 3.0),)),
        commands.CommandExchange(TARGET, 400),
        mode_change.change_mode(TARGET, 65536, True),
    ],
)
def test_a_dead_link_ends_in_one_line(exchange: exchange.Exchange) -> None:
    ended = converse(exchange, LossyVehicle(loss=1.0), limit=20.0)
    assert ended.failure and "\n" not in ended.failure


def test_a_vehicle_without_mode_names_is_no_failure() -> None:
    ended = converse(mode_change.request_mode_names(TARGET), LossyVehicle(loss=1.0), limit=20.0)
    assert not ended.failure and not ended.names


@LOSSES
@SEEDS
def test_parameter_write_reads_back(loss: float, seed: int) -> None:
    vehicle = LossyVehicle(loss, seed)
    known = converse(parameters.ParameterRead(TARGET, "GAIN_3"), vehicle).value
    written = converse(parameters.ParameterWrite(TARGET, known, 0.1), vehicle)
    assert not written.failure
    assert vehicle.values["GAIN_3"] == 0.1


def test_a_clipped_value_is_told() -> None:
    vehicle = LossyVehicle()
    vehicle.limits["GAIN_3"] = 5.0
    known = parameters.Parameter("GAIN_3", 3.0, 9, 3)
    written = converse(parameters.ParameterWrite(TARGET, known, 99.0), vehicle)
    assert written.failure == "GAIN_3 is 5 after the request of 99"


def test_a_late_answer_to_the_reading_before_does_not_refuse_a_value() -> None:
    known = parameters.Parameter("GAIN_3", 3.0, 9, 3)
    write = parameters.ParameterWrite(TARGET, known, 0.5)
    write, _ = write.step(0.0, None)
    late, answer = (mavlink.MAVLink_param_value_message(b"GAIN_3", value, 9, 40, 3) for value in (3.0, 0.5))
    write, _ = write.step(0.1, late)
    write, _ = write.step(0.1 + exchange.EXPLANATION, None)
    assert not write.finished
    write, _ = write.step(0.6, answer)
    assert write.finished and not write.failure


def test_a_vehicle_that_keeps_its_value_without_a_word_is_told_in_the_end() -> None:
    vehicle = LossyVehicle()
    vehicle.limits["GAIN_3"] = 3.0
    known = parameters.Parameter("GAIN_3", 3.0, 9, 3)
    written = converse(parameters.ParameterWrite(TARGET, known, 99.0), vehicle, limit=5.0)
    assert written.failure == "GAIN_3 is 3 after the request of 99"


class Strict(LossyVehicle):
    """Answers a value out of range as our own flight computer does: the old value, the error, and why."""

    def __init__(self, why: str) -> None:
        super().__init__()
        self.why = [why[start : start + 50] for start in range(0, len(why), 50)]

    def _param_set(self, message: Any) -> list[Any]:
        error = mavlink.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
        texts = [
            mavlink.MAVLink_statustext_message(4, part.encode(), 7 * (len(self.why) > 1), number)
            for number, part in enumerate(self.why)
        ]
        return [self._value("GAIN_3"), mavlink.MAVLink_param_error_message(255, 190, b"GAIN_3", 3, error), *texts]


@pytest.mark.parametrize(
    ("why", "stated"),
    [
        ("GAIN_3 must be within 0 and 5 rad/s", "GAIN_3 must be within 0 and 5 rad/s"),
        ("GAIN_3 must be within -1.23456e-07 and 1.23456e+07 kg m^2/s^2", "-1.23456e-07 and 1.23456e+07 kg m^2/s^2"),
        ("", "value out of range"),
    ],
)
def test_a_value_out_of_range_is_refused_with_the_range_that_the_vehicle_tells(why: str, stated: str) -> None:
    written = converse(
        parameters.ParameterWrite(TARGET, parameters.Parameter("GAIN_3", 3.0, 9, 3), 99.0), Strict(why)
    )
    assert written.failure.startswith("parameter rejected: GAIN_3 = 99: ") and written.failure.endswith(stated)
    assert written.answer is None


def test_an_unknown_parameter_is_told() -> None:
    read = converse(parameters.ParameterRead(TARGET, "NOPE"), LossyVehicle())
    assert read.failure == "the vehicle has no parameter NOPE"


MISSION = tuple(missions.Item(3, 16, (0.0, 1.0, 0.0, 90.0), 10 * n, -20 * n, 40.0 + n) for n in range(12))


@LOSSES
@SEEDS
def test_mission_round_trip(loss: float, seed: int) -> None:
    vehicle = LossyVehicle(loss, seed)
    assert not converse(missions.MissionUpload(TARGET, MISSION), vehicle).failure
    assert tuple(vehicle.mission) == MISSION
    vehicle.expected_items = 0
    assert converse(missions.MissionDownload(TARGET), vehicle).items == MISSION


def test_an_empty_mission_is_downloaded() -> None:
    ended = converse(missions.MissionDownload(TARGET), LossyVehicle())
    assert ended.items == () and not ended.failure


def test_a_refused_mission_says_why() -> None:
    upload = missions.MissionUpload(TARGET, MISSION)
    upload, _ = upload.step(0.0, None)
    upload, _ = upload.step(0.1, mavlink.MAVLink_statustext_message(4, b"armed: land first"))
    upload, _ = upload.step(0.2, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_DENIED))
    assert upload.failure == "mission rejected: denied: armed: land first"


def test_a_refused_mission_waits_for_the_reason_that_follows() -> None:
    upload = missions.MissionUpload(TARGET, MISSION)
    upload, _ = upload.step(0.0, None)
    upload, _ = upload.step(0.1, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_INVALID_PARAM1))
    upload, _ = upload.step(0.15, None)
    assert not upload.finished
    for part in ("mission item 3: a circle needs a radius, of which it s", "aid none"):
        text = mavlink.MAVLink_statustext_message(4, part.encode(), 7, int(part == "aid none"))
        upload, _ = upload.step(0.2, text)
    upload, _ = upload.step(0.2, None)
    stated = "invalid param1: mission item 3: a circle needs a radius, of which it said none"
    assert upload.failure == f"mission rejected: {stated}"


def test_a_mission_refused_without_a_word_ends_soon() -> None:
    upload = missions.MissionUpload(TARGET, MISSION)
    upload, _ = upload.step(0.0, None)
    upload, _ = upload.step(0.1, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_NO_SPACE))
    upload, _ = upload.step(0.2, mavlink.MAVLink_statustext_message(6, b"logging"))
    upload, _ = upload.step(0.2 + exchange.EXPLANATION, None)
    assert upload.failure == "mission rejected: no space"


class Curt(LossyVehicle):
    """Acknowledges a mission once, as vehicles do; ``repeated`` is what a last item gets that came before."""

    def __init__(self, repeated: int | None, loss: float = 0.0, seed: int = 1, acks_lost: int = 0) -> None:
        super().__init__(loss, seed)
        self.repeated, self.acks_lost, self.refuses = repeated, acks_lost, False

    def _mission_item_int(self, message: Any) -> list[Any]:
        if self.expected_items:
            return super()._mission_item_int(message)
        repeated = self.repeated
        return [] if repeated is None else [mavlink.MAVLink_mission_ack_message(255, 190, repeated)]

    def repeat_request(self) -> list[Any]:
        answer = super().repeat_request()
        if not self.expected_items or len(self.incoming) < self.expected_items:
            return answer
        self.expected_items, self.acks_lost = 0, self.acks_lost - 1
        if self.refuses:
            self.mission = []
            answer = [mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_INVALID)]
        return answer if self.acks_lost < 0 else []


REPEATED = pytest.mark.parametrize(
    "repeated", [mavlink.MAV_MISSION_ACCEPTED, mavlink.MAV_MISSION_ERROR, mavlink.MAV_MISSION_INVALID_SEQUENCE, None]
)
"""by PX4 and ours; by ArduPilot; for an item out of turn; by who drops it"""


@REPEATED
def test_a_mission_whose_last_acknowledgement_alone_was_lost_is_known_to_be_aboard(repeated: int | None) -> None:
    vehicle = Curt(repeated, acks_lost=1)
    ended = converse(missions.MissionUpload(TARGET, MISSION), vehicle)
    assert ended.accepted and not ended.failure
    assert tuple(vehicle.mission) == MISSION
    # Who acknowledges a repeated item is not sent everything again.
    assert vehicle.requests.count("MISSION_COUNT") == (1 if repeated == mavlink.MAV_MISSION_ACCEPTED else 2)


@REPEATED
def test_a_refusal_that_was_lost_is_heard_in_the_end(repeated: int | None) -> None:
    vehicle = Curt(None if repeated == mavlink.MAV_MISSION_ACCEPTED else repeated, acks_lost=1)
    vehicle.refuses = True
    ended = converse(missions.MissionUpload(TARGET, MISSION), vehicle)
    assert ended.failure == "mission rejected: invalid"


def test_a_mission_that_is_never_confirmed_is_a_failure_that_says_so() -> None:
    ended = converse(missions.MissionUpload(TARGET, MISSION), Curt(None, acks_lost=99))
    assert ended.failure == "sent all 12 mission items, not confirmed by the vehicle"


@REPEATED
@pytest.mark.parametrize("seed", range(8))
def test_a_mission_gets_aboard_over_a_bad_radio_though_it_is_acknowledged_once(
    repeated: int | None, seed: int
) -> None:
    """Given 30 % loss, 10 % doubled and 300 ms each way."""
    vehicle = Curt(repeated, 0.3, seed)
    ended = converse(missions.MissionUpload(TARGET, MISSION), vehicle, limit=240.0, doubled=0.1, delay=0.3)
    assert not ended.failure and tuple(vehicle.mission) == MISSION


def test_an_item_out_of_turn_does_not_refuse_the_mission() -> None:
    upload = missions.MissionUpload(TARGET, MISSION)
    upload, _ = upload.step(0.0, None)
    upload, _ = upload.step(0.1, mavlink.MAVLink_mission_request_int_message(255, 190, 0))
    upload, _ = upload.step(0.2, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_INVALID_SEQUENCE))
    upload, _ = upload.step(2.0, None)
    assert not upload.finished
    upload, sent = upload.step(2.1, mavlink.MAVLink_mission_request_int_message(255, 190, 1))
    assert sent[0].seq == 1


def test_an_acknowledgement_before_everything_was_sent_is_none() -> None:
    upload = missions.MissionUpload(TARGET, MISSION)
    upload, _ = upload.step(0.0, None)
    upload, _ = upload.step(0.1, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED))
    assert not upload.finished


def test_an_acknowledgement_of_an_older_transfer_is_ignored() -> None:
    upload = missions.MissionUpload(TARGET, MISSION)
    upload, _ = upload.step(0.0, mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED))
    assert not upload.finished


@LOSSES
@SEEDS
def test_mode_change_is_confirmed_by_heartbeat(loss: float, seed: int) -> None:
    vehicle = LossyVehicle(loss, seed)
    wanted = 4 << 16 | 5 << 24
    change = converse(mode_change.change_mode(TARGET, wanted, True), vehicle)
    assert change.confirmed and vehicle.custom_mode == wanted


def test_an_acknowledged_mode_that_never_comes_is_a_failure() -> None:
    vehicle = LossyVehicle()
    vehicle.reports = ["no GPS fix"]
    change = mode_change.change_mode(TARGET, 7, False)
    ended = converse(change, vehicle, limit=20.0)
    assert ended.failure == "the vehicle accepted the mode but did not change to it: no GPS fix"


def test_a_refused_command_gives_the_vehicles_words_even_behind_the_acknowledgement() -> None:
    vehicle = LossyVehicle()
    vehicle.results[400] = mavlink.MAV_RESULT_DENIED
    vehicle.reports = ["not level"]
    ended = converse(commands.CommandExchange(TARGET, 400, (1.0,)), vehicle)
    assert ended.failure == "COMPONENT_ARM_DISARM denied: not level"
    vehicle.reports = []
    ended = converse(commands.CommandExchange(TARGET, 400, (1.0,)), vehicle)
    assert ended.failure == "COMPONENT_ARM_DISARM denied: denied"


class Booting(LossyVehicle):
    """Takes no command before it has rejected some."""

    def __init__(self, rejects: int) -> None:
        super().__init__()
        self.rejects, self.reports = rejects, ["no sensor frames"]

    def _command_long(self, message: Any) -> list[Any]:
        self.rejects -= 1
        later, taken = mavlink.MAV_RESULT_TEMPORARILY_REJECTED, mavlink.MAV_RESULT_ACCEPTED
        self.results[message.command] = later if self.rejects >= 0 else taken
        return super()._command_long(message)


@pytest.mark.parametrize(
    "order", [commands.CommandExchange(TARGET, 400, (1.0,)), mode_change.change_mode(TARGET, 4 << 16 | 5 << 24, True)]
)
def test_what_is_rejected_for_the_moment_is_asked_again_for_a_few_seconds(order: exchange.Exchange) -> None:
    vehicle = Booting(rejects=4)
    ended = converse(order, vehicle, limit=exchange.NOT_YET)
    assert not ended.failure and vehicle.requests.count("COMMAND_LONG") == 5
    vehicle = Booting(rejects=99)
    ended = converse(order, vehicle, limit=exchange.NOT_YET + 2.0)
    assert ended.failure.endswith(" denied: no sensor frames")
    assert 5 <= vehicle.requests.count("COMMAND_LONG") <= 12


def test_that_it_is_asked_again_is_said_once_with_the_reason() -> None:
    vehicle, order, notes = Booting(rejects=5), commands.CommandExchange(TARGET, 400, (1.0,)), []
    now, inbox = 0.0, []
    while not order.finished:
        now += 0.1
        for message in [*inbox, None]:
            order, sent = order.step(now, message)
            inbox = [answer for asked in sent for answer in vehicle.answers(asked)]
        notes.append(order.progress().note)
    stated = "COMPONENT_ARM_DISARM denied: no sensor frames; retrying"
    assert {note for note in notes if note} == {stated}


def test_a_command_in_progress_is_waited_for() -> None:
    command = commands.CommandExchange(TARGET, 241)
    command, _ = command.step(0.0, None)
    command, _ = command.step(0.1, mavlink.MAVLink_command_ack_message(241, mavlink.MAV_RESULT_IN_PROGRESS))
    command, sent = command.step(9.0, None)
    assert not command.finished and not sent
    command, _ = command.step(10.0, mavlink.MAVLink_command_ack_message(241, mavlink.MAV_RESULT_ACCEPTED))
    assert command.finished and not command.failure


@given(
    st.sampled_from(
        [(1, 0, 255), (2, -128, 127), (3, 0, 65535), (4, -32768, 32767), (5, 0, 2**24), (6, -(2**24), 2**24)]
    ),
    st.data(),
    st.booleans(),
)
def test_integers_survive_both_encodings(kind: tuple[int, int, int], data: st.DataObject, bytewise: bool) -> None:
    value = data.draw(st.integers(kind[1], kind[2]))
    if bytewise and math.isnan(struct.unpack("<f", struct.pack("<i", value if value < 2**31 else 0))[0]):
        return  # whether a NaN keeps its bytes is the processor's choice; encode_value refuses those that do not
    wire = parameters.encode_value(value, kind[0], bytewise)
    message = mavlink.MAVLink_param_value_message(b"X", wire, kind[0], 1, 0)
    assert parameters.decode_parameter(message, bytewise).value == value


@pytest.mark.parametrize(("value", "kind"), [(1.5, 1), (256, 1), (-1, 3), (2**31, 6)])
def test_a_value_that_does_not_fit_its_type_is_refused(value: float, kind: int) -> None:
    with pytest.raises(ValueError, match=r"whole number|does not fit"):
        parameters.encode_value(value, kind, bytewise=True)


def test_other_traffic_changes_nothing() -> None:
    noise = [mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0), mavlink.MAVLink_command_ack_message(1, 0)]
    exchanges: list[exchange.Exchange] = [
        parameters.ParameterDownload(TARGET), missions.MissionUpload(TARGET, MISSION),
        commands.CommandExchange(TARGET, 400),
    ]  # fmt: skip
    for one in exchanges:
        for message in noise:
            assert one.step(1.0, message) == (one, ())
    assert math.isinf(exchange.Timer().sent_at)


@pytest.mark.parametrize("seed", range(6))
def test_everything_transfers_whole_over_a_bad_radio(seed: int) -> None:
    """Given 30 % loss, 10 % doubled and 300 ms each way, when lists are sent, then they are whole."""
    vehicle = LossyVehicle(0.3, seed)
    radio = {"limit": 240.0, "doubled": 0.1, "delay": 0.3}
    download = converse(parameters.ParameterDownload(TARGET), vehicle, **radio)
    assert {p.name: p.value for p in download.values.values()} == vehicle.values
    known = converse(parameters.ParameterRead(TARGET, "GAIN_3"), vehicle, **radio).value
    assert not converse(parameters.ParameterWrite(TARGET, known, 0.7), vehicle, **radio).failure
    assert vehicle.values["GAIN_3"] == 0.7
    assert not converse(missions.MissionUpload(TARGET, MISSION), vehicle, **radio).failure
    assert tuple(vehicle.mission) == MISSION
    vehicle.expected_items = 0
    assert converse(missions.MissionDownload(TARGET), vehicle, **radio).items == MISSION
    assert converse(mode_change.change_mode(TARGET, 4 << 16, True), vehicle, **radio).confirmed
