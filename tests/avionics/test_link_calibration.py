"""Calibration and storage by command: acknowledged as in progress, then as it ended."""

from typing import Any

import pytest
from link_vehicle import FakeVehicle

from avionics import topics as t
from avionics.link.budget import Budget
from avionics.link.dialect import mavlink
from avionics.link.services.calibration import CalibrationRequests
from avionics.link.services.command_result import Request
from avionics.link.services.parameters import ParameterService
from avionics.link.services.service import Reply, Sender
from avionics.link.services.storage import StorageRequests
from avionics.link.vehicle import LinkGains
from avionics.messages import Calibration, CalibrationStatus, CommandKind
from wingbeat.errors import InputError

STATION = Sender(255, 190, 0, None)
OTHER = Sender(254, 190, 0, None)
CALIBRATION = mavlink.MAV_CMD_PREFLIGHT_CALIBRATION
ACCEPTED, DENIED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED
FAILED, IN_PROGRESS = mavlink.MAV_RESULT_FAILED, mavlink.MAV_RESULT_IN_PROGRESS
UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED


def requested(*params: float, sender: Sender = STATION, command: int = CALIBRATION) -> Request:
    return Request(command, (*params, *(0.0,) * (7 - len(params))), sender)


def set_progress(vehicle: FakeVehicle, running: int, progress: float, started: int = 1, succeeded: int = 0) -> None:
    vehicle.topics[t.CALIBRATION.name] = CalibrationStatus(
        0, Calibration.MAGNETOMETER, running, progress, started, succeeded, 0.0
    )


def acks(outputs: list[Any]) -> list[tuple[int, int]]:
    return [(reply.message.result, reply.message.progress) for reply in outputs if isinstance(reply, Reply)]


@pytest.mark.parametrize(
    ("params", "kind"),
    [
        ((0, 1), "MAGNETOMETER"),
        ((0, 0, 0, 0, 1), "ACCELEROMETER"),
        ((0, 0, 0, 0, 2), "LEVEL"),
        ((0, 0, 0, 0, 0, 1), "AIRSPEED_ZERO"),
        ((0, 0, 0, 0, 0, 2), "AIRSPEED_ZERO"),
    ],
)
def test_each_parameter_begins_its_calibration(params: tuple[float, ...], kind: str) -> None:
    command_result = CalibrationRequests(FakeVehicle()).answer(requested(*params))
    assert command_result.result == IN_PROGRESS
    assert [(command.kind, command.name) for command in command_result.outputs] == [(CommandKind.CALIBRATE, kind)]


def test_our_own_command_says_kind_and_what_is_given() -> None:
    requests = CalibrationRequests(FakeVehicle())
    command_result = requests.answer(requested(7, 7.8, command=mavlink.MAV_CMD_WINGBEAT_CALIBRATE))
    assert [(command.name, command.value) for command in command_result.outputs] == [("BATTERY", 7.8)]
    for wrong in (0.0, 99.0, 1.5, float("nan")):
        other = CalibrationRequests(FakeVehicle())
        assert other.answer(requested(wrong, command=mavlink.MAV_CMD_WINGBEAT_CALIBRATE)).result == UNSUPPORTED


def test_it_is_in_progress_until_the_core_has_ended_it() -> None:
    vehicle = FakeVehicle()
    requests = CalibrationRequests(vehicle)
    requests.answer(requested(0, 1))
    assert requests.step(10.0) == []
    set_progress(vehicle, running=1, progress=0.4)
    assert requests.step(10.5) == []
    assert acks(requests.step(11.1)) == [(IN_PROGRESS, 40)]
    assert requests.answer(requested(0, 1)).result == IN_PROGRESS
    assert requests.answer(requested(0, 1)).outputs == ()
    set_progress(vehicle, running=0, progress=1.0, succeeded=1)
    ended = requests.step(11.2)
    assert acks(ended) == [(ACCEPTED, 100)]
    assert ended[0].to == STATION
    assert requests.step(13.0) == []


def test_a_calibration_that_fails_or_never_begins_is_told_as_failed() -> None:
    vehicle = FakeVehicle()
    requests = CalibrationRequests(vehicle)
    requests.answer(requested(0, 1))
    requests.step(10.0)
    set_progress(vehicle, running=0, progress=0.0, succeeded=0)
    assert acks(requests.step(10.2)) == [(FAILED, 100)]
    silent = CalibrationRequests(FakeVehicle())
    silent.answer(requested(0, 1))
    silent.step(10.0)
    assert acks(silent.step(11.5)) == [(FAILED, 100)]


def test_the_success_of_an_earlier_one_is_not_taken_for_this_ones() -> None:
    vehicle = FakeVehicle()
    set_progress(vehicle, running=0, progress=1.0, started=4, succeeded=1)
    requests = CalibrationRequests(vehicle)
    requests.answer(requested(0, 1))
    assert requests.step(10.0) == []
    set_progress(vehicle, running=1, progress=0.1, started=5, succeeded=1)
    assert requests.step(10.1) == []
    set_progress(vehicle, running=0, progress=0.0, started=5, succeeded=0)
    assert acks(requests.step(10.2)) == [(FAILED, 100)]


def test_refusals_are_denied_with_the_cores_reason_and_gyroscopes_are_not_supported() -> None:
    vehicle = FakeVehicle()
    vehicle.refusals[CommandKind.CALIBRATE] = "calibration denied: armed"
    command_result = CalibrationRequests(vehicle).answer(requested(0, 1))
    assert (command_result.result, command_result.reason, command_result.outputs) == (
        DENIED,
        "calibration denied: armed",
        (),
    )
    for params in ((1.0,), (0.0, 0.0, 1.0)):
        assert CalibrationRequests(FakeVehicle()).answer(requested(*params)).result == UNSUPPORTED
    busy = CalibrationRequests(FakeVehicle())
    busy.answer(requested(0, 1))
    assert busy.answer(requested(0, 0, 0, 0, 1, sender=OTHER)).result == DENIED


def test_all_zeros_cancel() -> None:
    command_result = CalibrationRequests(FakeVehicle()).answer(requested())
    assert command_result.result == ACCEPTED
    assert [(command.kind, command.name) for command in command_result.outputs] == [(CommandKind.CALIBRATE, "")]


def test_a_parameter_that_a_calibration_changed_is_sent_to_everyone_once() -> None:
    vehicle = FakeVehicle()
    service = ParameterService(vehicle, LinkGains(), [Budget(0).available_bytes])
    assert service.step(0.0) == []
    vehicle.parameters = [vehicle.parameters[0], vehicle.parameters[1]._replace(value=0.5), *vehicle.parameters[2:]]
    (sent,) = service.step(0.1)
    assert isinstance(sent, Reply)
    assert (sent.to, sent.message.param_id, sent.message.param_value) == (None, "CLIMB_P", 0.5)
    assert service.step(0.2) == []


# --- storage --------------------------------------------------------------------------------------------


class Kept:
    """A storage in memory."""

    def __init__(self, values: dict[str, float] | None) -> None:
        self.values = values
        self.saved: dict[str, float] = {}

    def stored(self) -> dict[str, float]:
        if self.values is None:
            raise InputError("the file is damaged")
        return self.values

    def defaults(self) -> dict[str, float]:
        return {"PITCH_P": 0.8, "CLIMB_P": 0.3}

    def save(self, values: dict[str, float]) -> None:
        self.saved = dict(values)


def storage(what: float, kept: Kept | None, armed: bool = False) -> Any:
    vehicle = FakeVehicle()
    vehicle.armed = armed
    request = requested(what, command=mavlink.MAV_CMD_PREFLIGHT_STORAGE)
    return StorageRequests(vehicle, kept).answer(request)


def test_storage_reads_writes_and_resets() -> None:
    kept = Kept({"PITCH_P": 1.25})
    read = storage(0.0, kept)
    assert [(command.name, command.value) for command in read.outputs] == [("PITCH_P", 1.25), ("CLIMB_P", 0.3)]
    assert all(command.kind is CommandKind.SET_PARAMETER for command in read.outputs)
    assert storage(1.0, kept).result == ACCEPTED
    assert kept.saved["CLIMB_P"] == 0.1
    reset = storage(2.0, kept)
    assert [(command.name, command.value) for command in reset.outputs] == [("CLIMB_P", 0.3)]


def test_storage_is_refused_armed_without_a_file_and_with_a_damaged_one() -> None:
    assert (storage(1.0, None).result, storage(1.0, Kept({}), armed=True).result) == (DENIED, DENIED)
    damaged = storage(0.0, Kept(None))
    assert (damaged.result, damaged.reason) == (FAILED, "storage: the file is damaged")
    assert storage(9.0, Kept({})).result == UNSUPPORTED
