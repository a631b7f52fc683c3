"""A simulated flight by joystick: MANUAL_CONTROL over a link, mode and arm buttons, loss of the device."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from fake_joystick import RADIO, SETTINGS, FakeBackend, FakeDevice
from ports import free_port
from scipy.spatial.transform import Rotation

from avionics.link.ground import GroundLink
from avionics.link.vehicle import PROFILES
from avionics.messages import ActuatorCommand, Mode, PilotSource, SensorFrame
from avionics.missions import load_mission
from avionics.recorder import NullRecorder
from avionics.runtime.flight_computer import FlightComputer
from avionics.vehicles import load_vehicle
from groundstation.joystick.actions import Action, ActionKind, Assignments
from groundstation.joystick.control import DEFAULT_RATE, ManualControl
from groundstation.link.connection import Connection
from groundstation.link.station import Station
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle as load_world

VEHICLE = "robo_raven_ii_d"
ARM, STABILIZED, MANUAL = 0, 1, 2
BUTTONS = {
    ARM: Action(ActionKind.ARM_SWITCH),
    STABILIZED: Action(ActionKind.MODE, "STABILIZED"),
    MANUAL: Action(ActionKind.MODE, "MANUAL"),
}
ROLL, PITCH, THROTTLE = 0, 1, 2
SETTLED = 9.0
"""s since boot; the attitude is known, so that arming is accepted"""

Step = tuple[float, Callable[["Flight"], None]]


class Flight:
    """World, flight computer and ground station in one thread and on one clock, joined by UDP."""

    def __init__(self, steps: Sequence[Step], duration: float) -> None:
        self.time = 0.0
        self.joystick = FakeDevice()
        self.commands: list[ActuatorCommand] = []
        self._steps = list(steps)
        self._duration = duration
        self._command = NEUTRAL
        self.world = SimulatedWorld(load_world(VEHICLE), Scenario(waits_for_arming=True, launch_time=SETTLED))
        port = free_port()
        clock = lambda: self.time  # noqa: E731
        self.onboard = FlightComputer(load_vehicle(VEHICLE), load_mission("circuit"), NullRecorder(), clock=clock)
        link = GroundLink([f"udpin:127.0.0.1:{port}"], self.onboard.view, PROFILES["ardupilot"])
        connection = Connection(f"udpout:127.0.0.1:{port}", stays=True, clock=clock)
        self.station = Station(connection, clock)
        settings = SETTINGS._replace(assignments=Assignments(BUTTONS))
        self.control = ManualControl(self.station, FakeBackend(self.joystick), self.joystick, settings)
        try:
            self.onboard.fly(self, link)
        finally:
            connection.close()
            link.close()

    def read(self) -> SensorFrame | None:
        """Advance the world by a tick, the pilot and the ground station with it; the board of the flight."""
        if self.world.finished or self.time >= self._duration:
            return None
        frame = self.world.step(self._command)
        self.time = frame.time_us * 1e-6
        while self._steps and self._steps[0][0] <= self.time:
            self._steps.pop(0)[1](self)
        self.control.poll()
        return frame

    def write(self, command: ActuatorCommand) -> None:
        self._command = command
        self.commands.append(command)

    def close(self) -> None:
        pass

    @property
    def mode(self) -> Mode:
        return self.onboard.view.mode

    @property
    def roll(self) -> float:
        """rad; true bank, right wing down is positive"""
        truth = self.world.truth()
        quaternion = (truth.quaternion_x, truth.quaternion_y, truth.quaternion_z, truth.quaternion_w)
        return float(Rotation.from_quat(quaternion).as_euler("ZYX")[2])

    def notes(self) -> list[str]:
        return [note.text for note in self.station.picture().notes]


def press(*buttons: int) -> Callable[[Flight], None]:
    return lambda flight: flight.joystick.pressed.update(buttons)


def move(axis: int, value: float) -> Callable[[Flight], None]:
    return lambda flight: flight.joystick.axes.__setitem__(axis, value)


def test_flight_by_joystick_with_loss_of_the_device() -> None:
    """GIVEN a vehicle in the launcher's hand WHEN it is flown by joystick THEN it banks with the roll stick.

    WHEN the joystick is disconnected in flight THEN the failsafe of the vehicle circles; after a reconnection and the
    mode button MANUAL the elevator follows the pitch stick.
    """
    banks: list[float] = []
    states: list[tuple[Mode, PilotSource]] = []
    elevators: list[float] = []

    def measure(flight: Flight) -> None:
        banks.append(flight.roll)
        states.append((flight.mode, PilotSource(flight.onboard.view.autopilot.memory.pilot.source)))
        elevators.append(flight.commands[-1].elevator)

    def unplug(flight: Flight) -> None:
        flight.joystick.connected = False

    def plug(flight: Flight) -> None:
        flight.joystick.connected = True
        flight.joystick.axes[ROLL] = 0.0

    steps = [
        (SETTLED, press(STABILIZED)),
        (SETTLED + 0.5, press(ARM)),
        (SETTLED + 1.0, move(THROTTLE, 0.5)),
        (15.5, move(ROLL, 0.6)),
        (17.0, measure),
        (17.0, move(ROLL, -0.6)),
        (19.0, measure),
        (19.0, unplug),
        (20.5, measure),
        (20.5, plug),
        (21.2, press(MANUAL)),
        (21.5, move(PITCH, 0.5)),
        (21.7, measure),
        (21.7, move(PITCH, -0.5)),
        (21.9, measure),
    ]
    flight = Flight(steps, 22.0)
    name = RADIO.name
    assert flight.notes() == [
        "mode STABILIZED",
        "armed",
        f"joystick {name} disconnected: no sticks are sent",
        f"joystick {name} reconnected",
        "mode MANUAL",
    ]
    assert states == [
        (Mode.STABILIZED, PilotSource.MANUAL_CONTROL),
        (Mode.STABILIZED, PilotSource.MANUAL_CONTROL),
        (Mode.LOITER, PilotSource.NONE),
        (Mode.MANUAL, PilotSource.MANUAL_CONTROL),
        (Mode.MANUAL, PilotSource.MANUAL_CONTROL),
    ]
    tail = load_vehicle(VEHICLE).gains.tail
    assert banks[0] > 0.1 and banks[1] < -0.1
    assert elevators[3] - elevators[4] == pytest.approx(0.5 * (tail.elevator_max - tail.elevator_min))
    assert flight.control.status.sent == pytest.approx(DEFAULT_RATE * (22.0 - 1.5), rel=0.02)
