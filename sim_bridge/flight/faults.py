"""What can fail on a simulated flight, by name: what the sensors then read, or what the actuators then do.

A fault begins at a time and lasts until another one, or for good. To add one: write what it does to a raw frame or to
the plant, and enter it in ``FAULTS``; the tests and the table of promises then ask for it by its name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from avionics.messages import Command, CommandKind
from avionics.missions.reader import find
from sim_bridge.bridge.world import SimulationSilent
from sim_bridge.sensors.frame import TICK_RATE, imu_on_the_wire
from sim_bridge.sensors.optional import OPTIONAL
from sim_bridge.sensors.receiver import ReceiverSpec
from wingbeat.errors import InputError
from wingbeat.samples import PressureSample, ReceiverSample, SensorFrame
from wingbeat.schema import error_context, read_document, read_record
from wingbeat.units import Quantity

if TYPE_CHECKING:
    from sim_bridge.plant import Plant

SPIKE_COUNTS = 60_000
"""counts; of 0.01 Pa, amplitude of a spike: 600 Pa, equivalent to 50 m"""
SPIKE_SAMPLES = 10
"""pressure samples between two spikes"""
DISTURBANCE = (0.35, -0.25, 0.3)
"""gauss; added to the magnetic field in body axes, equal to the earth's magnitude"""
FULL_SCALE = 156.87
"""m/s^2; 4095 counts of 3.9 mg: end of the ADXL345's range"""
FULL_RATE = math.radians(2000.0)
"""rad/s; end of the ITG-3200's range"""
RECEIVER_PATIENCE = round(ReceiverSpec().timeout * TICK_RATE)
"""ticks; without a signal before the receiver reports the loss"""
CLOCK_STEP_US = 3_000_000
"""us; backward step of the sensors' clock"""
LOW_SHARE, CRITICAL_SHARE = 0.15, 0.04
"""-; remaining fraction of the battery's charge"""


class Place(Enum):
    """Point of action of a fault."""

    SENSORS = "in the sensors' output"
    PLANT = "in the plant"
    BOARD = "at the edge of the world"
    FLIGHT = "as an input of the flight"


class Before(NamedTuple):
    """Sensor data before the fault."""

    pressures: PressureSample | None
    """the first sample since boot, at zero airspeed"""
    frame: SensorFrame
    """the last frame before the fault"""
    receiver: ReceiverSample | None = None
    """the last frame of the radio-control receiver"""
    static_counts: int | None = None
    """the last static pressure"""


Sense = Callable[[SensorFrame, Before, int], SensorFrame]
"""a raw frame, the data before the fault, ticks since the fault began -> the frame that is read"""


class Kind(NamedTuple):
    """Row of the table of faults."""

    text: str
    """description for users"""
    place: Place
    sense: Sense | None = None
    """for `Place.SENSORS`"""
    begin: Callable[[Plant], None] | None = None
    """for `Place.PLANT`"""
    end: Callable[[Plant], None] | None = None
    """for `Place.PLANT`; None if the fault is permanent"""
    needs: str = ""
    """required section of the vehicle file"""


class Fault(NamedTuple):
    """Fault of a flight."""

    name: str
    """name of a row of `FAULTS`"""
    at: Annotated[float, Quantity("s", 0.0)]
    """s; since boot"""
    until: Annotated[float, Quantity("s", 0.0)] = math.inf
    """s; since boot"""


# --- what the sensors read ------------------------------------------------------------------------------


def _no_fix(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    return frame._replace(gps=None)


def _blocked_pitot(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Simulate a blocked tube with an open drain: the total pressure equals the static pressure."""
    if frame.pressures is None or before.pressures is None:
        return frame
    return frame._replace(
        pressures=frame.pressures._replace(differential_counts=before.pressures.differential_counts)
    )


def _disturbed_field(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    imu, (x, y, z) = frame.imu, DISTURBANCE
    return frame._replace(imu=imu._replace(mag_x=imu.mag_x + x, mag_y=imu.mag_y + y, mag_z=imu.mag_z + z))


def _left_encoder_dead(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    if frame.encoder is None or before.frame.encoder is None:
        return frame
    return frame._replace(encoder=frame.encoder._replace(left_counts=before.frame.encoder.left_counts))


def _right_encoder_dead(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    if frame.encoder is None or before.frame.encoder is None:
        return frame
    return frame._replace(encoder=frame.encoder._replace(right_counts=before.frame.encoder.right_counts))


def _frozen_imu(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    return frame._replace(imu=before.frame.imu._replace(time_us=frame.imu.time_us))


def _saturated_imu(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Saturate the accelerometer on every axis; angular rates and magnetic field are not affected."""
    x, y, z = (math.copysign(FULL_SCALE, value) for value in before.frame.imu.accel)
    return frame._replace(imu=frame.imu._replace(accel_x=x, accel_y=y, accel_z=z))


def _saturated_gyro(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Saturate the gyro on every axis; specific force and magnetic field are not affected."""
    x, y, z = (math.copysign(FULL_RATE, value) for value in before.frame.imu.gyro)
    return frame._replace(imu=frame.imu._replace(gyro_x=x, gyro_y=y, gyro_z=z))


def _without_packets(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Simulate a transmitter that is off: first no frame, then repetitions of the last one, marked as lost."""
    if frame.receiver is None:
        return frame
    if ticks < RECEIVER_PATIENCE or before.receiver is None:
        return frame._replace(receiver=None)
    return frame._replace(receiver=before.receiver._replace(time_us=frame.time_us, lost=1, rssi=0))


def _baro_spikes(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Replace every tenth pressure sample, from the first on, by that of 50 m higher."""
    if frame.pressures is None or ticks // 4 % SPIKE_SAMPLES:
        return frame
    static = frame.pressures.static_counts - SPIKE_COUNTS
    return frame._replace(pressures=frame.pressures._replace(static_counts=static))


def _frozen_baro(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Freeze the static pressure; the differential pressure is not affected."""
    if frame.pressures is None or before.static_counts is None:
        return frame
    return frame._replace(pressures=frame.pressures._replace(static_counts=before.static_counts))


def _no_pressures(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    return frame._replace(pressures=None)


def _earlier(frame: SensorFrame, before: Before, ticks: int) -> SensorFrame:
    """Simulate a backward step of the clock of all sensors."""
    return frame.shifted(-CLOCK_STEP_US)


# --- what the plant does --------------------------------------------------------------------------------


def _drain(share: float) -> Callable[[Plant], None]:
    def drain(plant: Plant) -> None:
        drawn = (1.0 - share) * plant.vehicle.battery.capacity
        plant.y[plant.layout.charge] = max(drawn, float(plant.y[plant.layout.charge]))

    return drain


FAULTS: dict[str, Kind] = {
    "gps_lost": Kind("no GPS fix", Place.SENSORS, _no_fix),
    "pitot_blocked": Kind("pitot blocked, drain open: no airspeed", Place.SENSORS, _blocked_pitot),
    "mag_disturbed": Kind("magnetic disturbance as strong as the earth field", Place.SENSORS, _disturbed_field),
    "encoder_left_lost": Kind("left wing encoder stuck", Place.SENSORS, _left_encoder_dead),
    "encoder_right_lost": Kind("right wing encoder stuck", Place.SENSORS, _right_encoder_dead),
    "imu_frozen": Kind("IMU repeats its last sample", Place.SENSORS, _frozen_imu),
    "imu_saturated": Kind("accelerometer saturated", Place.SENSORS, _saturated_imu),
    "gyro_saturated": Kind("gyro saturated", Place.SENSORS, _saturated_gyro),
    "receiver_lost": Kind("no radio packets received", Place.SENSORS, _without_packets),
    "baro_spike": Kind("every tenth pressure is that of 50 m more altitude", Place.SENSORS, _baro_spikes),
    "baro_frozen": Kind("barometer repeats its last static pressure", Place.SENSORS, _frozen_baro),
    "baro_lost": Kind("no samples of barometer and pitot", Place.SENSORS, _no_pressures),
    "time_backwards": Kind("sensor clock jumps back by 3 s", Place.SENSORS, _earlier),
    "battery_low": Kind(f"{100 * LOW_SHARE:.0f} % of the charge remaining", Place.PLANT, begin=_drain(LOW_SHARE)),
    "battery_critical": Kind(
        f"{100 * CRITICAL_SHARE:.0f} % of the charge remaining", Place.PLANT, begin=_drain(CRITICAL_SHARE)
    ),
    "tail_jammed": Kind(
        "elevator and rudder jammed", Place.PLANT, None,
        lambda plant: plant.jam_tail(), lambda plant: plant.free_tail(),
    ),
    "wing_left_jammed": Kind(
        "left wing jammed, drive active (a crank stops both)", Place.PLANT, None,
        lambda plant: plant.jam_wing(0), lambda plant: plant.free_wing(0),
    ),
    "wing_right_jammed": Kind(
        "right wing jammed, drive active (a crank stops both)", Place.PLANT, None,
        lambda plant: plant.jam_wing(1), lambda plant: plant.free_wing(1),
    ),
    "sim_silent": Kind("simulator stops sending sensor frames", Place.BOARD),
    "link_lost": Kind("the ground station is not heard any more", Place.FLIGHT),
}  # fmt: skip


def _without(field: str) -> Sense:
    """Return a function that removes the sample ``field`` from a frame."""
    removed: dict[str, Any] = {field: None}
    return lambda frame, before, ticks: frame._replace(**removed)


FAULTS |= {
    row.fault: Kind(
        f"the {row.section.replace('_', ' ')} gives no sample", Place.SENSORS, _without(row.field), needs=row.section
    )
    for row in OPTIONAL
    if row.fault
}


# --- reading them ---------------------------------------------------------------------------------------


def parse_fault(text: str) -> Fault:
    """Parse a fault written as ``NAME@T`` or ``NAME@T-T2``, times in s since boot.

    Raises:
        InputError: unknown name, or times that are not nonnegative and increasing; the message lists the names.
    """
    name, at, times = text.partition("@")
    sign = "-" if times.startswith("-") else ""  # of the time, to be refused as what it is
    begin, dash, end = times.removeprefix(sign).partition("-")
    if not at:
        raise InputError(f"fault {text}: it must be NAME@T or NAME@T-T2; NAME one of {', '.join(FAULTS)}")
    return checked(Fault(name, _seconds(text, sign + begin), _seconds(text, end) if dash else math.inf))


def _seconds(text: str, number: str) -> float:
    try:
        return float(number)
    except ValueError:
        raise InputError(f"fault {text}: {number or 'nothing'} is not a time in seconds") from None


def checked(fault: Fault) -> Fault:
    """Return the fault after a check of its name and times.

    Raises:
        InputError: see `parse_fault`; also an end time of a permanent fault.
    """
    if fault.name not in FAULTS:
        raise InputError(f"no fault {fault.name}; known: {', '.join(FAULTS)}")
    if not 0.0 <= fault.at < math.inf:
        raise InputError(f"fault {fault.name}: its time must be 0 s or more since boot, not {fault.at:g}")
    if not fault.until > fault.at:
        raise InputError(
            f"fault {fault.name}: from {fault.at:g} s to {fault.until:g} s; the end must be after the start"
        )
    kind = FAULTS[fault.name]
    if math.isfinite(fault.until) and (kind.place is Place.BOARD or (kind.begin and not kind.end)):
        raise InputError(f"fault {fault.name} has no end: specify its start only")
    return fault


def mission_faults(name_or_path: str | Path) -> tuple[Fault, ...]:
    """Read the ``[[fault]]`` tables (name, at, until) of a mission file; empty for files of other formats.

    Raises:
        InputError: no such mission, not readable, an unknown name or key, an invalid time.
    """
    path = find(name_or_path)
    if path.suffix != ".toml":
        return ()
    tables = read_document(path, "mission file").get("fault", [])
    faults = []
    for number, table in enumerate(tables, 1):
        with error_context(f"{path}: fault {number}"):
            faults.append(checked(read_record(Fault, table)))
    return tuple(faults)


def check_carried(faults: Iterable[Fault], sections: Collection[str]) -> None:
    """Check that the vehicle has the sections that the faults require.

    Args:
        faults: of one flight.
        sections: of the vehicle's file.

    Raises:
        InputError: a missing section; the message names it and the fault.
    """
    for fault in faults:
        needed = FAULTS[fault.name].needs
        if needed and needed not in sections:
            raise InputError(f"fault {fault.name}: the vehicle file has no section [{needed}]")


def divided(faults: Iterable[Fault]) -> tuple[tuple[Fault, ...], tuple[Fault, ...]]:
    """Split into the faults of the world and those that are inputs of the flight."""
    every = tuple(checked(fault) for fault in faults)
    of_flight = tuple(fault for fault in every if FAULTS[fault.name].place is Place.FLIGHT)
    return tuple(fault for fault in every if fault not in of_flight), of_flight


# --- letting them happen --------------------------------------------------------------------------------


class FaultInjector:
    """Injector of the faults of the world into one flight, tick by tick."""

    def __init__(self, faults: Iterable[Fault]) -> None:
        """Select the faults of the world; those of the flight are ignored.

        Raises:
            InputError: see `checked`.
        """
        self._faults, _ = divided(faults)
        self._active: dict[Fault, int] = {}
        self._before: dict[Fault, Before] = {}
        self._boot: PressureSample | None = None
        self._last: SensorFrame | None = None
        self._received: ReceiverSample | None = None
        self._static: int | None = None

    def inject(self, fault: Fault) -> None:
        """Add one more fault of the world.

        Raises:
            InputError: see `checked`.
        """
        self._faults = (*self._faults, *divided([fault])[0])

    def act(self, plant: Plant, tick: int, time: float) -> list[str]:
        """Start and end the faults due at ``time`` s; return the events for the log.

        Raises:
            SimulationSilent: from the start of that fault.
        """
        said = []
        for fault in self._faults:
            present = fault.at <= time < fault.until
            if present != (fault in self._active):
                said.append(self._change(fault, plant, tick) if present else self._undo(fault, plant))
        return said

    def _change(self, fault: Fault, plant: Plant, tick: int) -> str:
        kind = FAULTS[fault.name]
        if kind.place is Place.BOARD:
            raise SimulationSilent(f"no sensor frame from {fault.at:g} s on: fault {fault.name}")
        self._active[fault] = tick
        if self._last is not None:
            self._before[fault] = Before(self._boot, self._last, self._received, self._static)
        if kind.begin is not None:
            kind.begin(plant)
        return f"fault {fault.name}: {kind.text}"

    def _undo(self, fault: Fault, plant: Plant) -> str:
        del self._active[fault]
        self._before.pop(fault, None)
        end = FAULTS[fault.name].end
        if end is not None:
            end(plant)
        return f"fault {fault.name} ended"

    def sense(self, frame: SensorFrame, tick: int) -> SensorFrame:
        """Return ``frame`` as modified by the active faults."""
        if self._boot is None:
            self._boot = frame.pressures
        healthy, pressures = frame, frame.pressures
        for fault, since in self._active.items():
            sense = FAULTS[fault.name].sense
            if sense is not None:
                frame = sense(frame, self._before.get(fault, Before(self._boot, healthy)), tick - since)
        if self._active and frame.imu is not healthy.imu:
            frame = frame._replace(imu=imu_on_the_wire(*frame.imu))
        self._last, self._received = healthy, healthy.receiver or self._received
        if pressures is not None:
            self._static = pressures.static_counts
        return frame


def fault_commands(faults: Sequence[Fault]) -> tuple[Command, ...]:
    """Return the commands of the ``faults`` that are inputs of the flight, at their start and end times.

    Raises:
        InputError: unknown fault, or invalid times.
    """
    entering = []
    for fault in divided(faults)[1]:
        entering.append(Command(round(fault.at * 1e6), CommandKind.LINK_LOST, source="fault"))
        if math.isfinite(fault.until):
            entering.append(Command(round(fault.until * 1e6), CommandKind.LINK_REGAINED, source="fault"))
    return tuple(entering)
