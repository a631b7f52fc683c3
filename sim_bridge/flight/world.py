"""The simulated world as the bridge plays it: launcher, plant, air and sensors, one sensor tick at a time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from avionics.messages import ActuatorCommand
from sim_bridge import plant_kernel as k
from sim_bridge import topics
from sim_bridge.bridge.world import NEUTRAL
from sim_bridge.environment import dryden
from sim_bridge.environment.home import COLLEGE_PARK, Home
from sim_bridge.environment.wind import steady_wind
from sim_bridge.flight.faults import Fault, FaultInjector, check_carried
from sim_bridge.flight.inputs import PlantInputs
from sim_bridge.flight.truth import Truth
from sim_bridge.messages import TruthLoads, TruthState, TruthWing
from sim_bridge.observation import Observation, Vector
from sim_bridge.plant import Plant
from sim_bridge.sensors.frame import TICK_RATE
from sim_bridge.sensors.receiver import Pilot, standing_by
from sim_bridge.sensors.suite import SensorSuite, SimulationDiverged, sensor_spec
from sim_bridge.vehicles import SimulatedVehicle
from sim_bridge.vibration.flight import field_per_ampere, make_unequal, vibration_of
from wingbeat.errors import InputError
from wingbeat.message import Event, Severity
from wingbeat.quaternions import quaternion_from_euler
from wingbeat.samples import SensorFrame
from wingbeat.topic import Publish, Topic

TICK = 1.0 / TICK_RATE
LAUNCH_TIME = 8.0
"""s; earliest launch: time for the flight computer to start and arm"""
LAUNCH_PATIENCE = 60.0
"""s; maximum wait of the launcher for steady air, and then for air without a gust from behind"""
LONGEST_WAIT = 300.0
"""s; maximum total wait while the air comes from behind; then the launcher throws"""
ARMED_TIME = 5.0
"""s; armed time before a launcher that waits for arming throws: time to change the mode"""
LAUNCH_GUST = 1.0
"""m/s; limit of lateral and vertical gusts for the launch"""
REST_TIME = 3.0
"""s; the flight ends after the vehicle has been at rest on the ground for this time"""
REST_SPEED = 0.3
"""m/s; speed below which the vehicle is at rest"""
RECORD_PERIOD_US = 4000
"""us; minimum recording period of the truth, independent of the step"""


class Throw(NamedTuple):
    """Deviation of the launch from the vehicle file."""

    speed: float = 1.0
    """-; factor of the launch speed"""
    pitch: float = 0.0
    """rad; added to the launch pitch"""
    bank: float = 0.0
    """rad; right wing down is positive"""


class Scenario(NamedTuple):
    """Conditions of a flight."""

    seed: int = 1
    wind_speed: float = 0.0
    """m/s; steady"""
    wind_from: float = 0.0
    """rad; direction the wind comes from, clockwise from north"""
    turbulence: str = "none"
    """Dryden gusts, one of `environment.levels.LEVELS`"""
    duration: float = 300.0
    """s; time limit"""
    home: Home = COLLEGE_PARK
    throw: Throw = Throw()
    sensor_corner: float = 0.0
    """-; if above 0, every fixed error of the sensors has this many standard deviations of either sign"""
    pilot: Pilot | None = None
    """pilot with a transmitter; None for no pilot, or an idle one if the fault is a lost transmitter"""
    faults: tuple[Fault, ...] = ()
    """faults, see `sim_bridge.flight.faults`"""
    waits_for_arming: bool = False
    """whether the launcher waits for arming, and reports its actions"""
    launch_time: float = LAUNCH_TIME
    """s; earliest launch; infinite: not before `SimulatedWorld.release`"""
    vibration: float = 0.0
    """-; factor of the vehicle's vibration; 0: none, and its random numbers are not drawn"""
    rest_time: float = REST_TIME
    """s; the flight ends after the vehicle has been at rest on the ground for this time"""


class StepClock:
    """Time in steps; equal steps are counted instead of summed, so that no error accumulates."""

    def __init__(self, length: float) -> None:
        """Start before the first step, of ``length`` s."""
        self.length = length
        """s; of a step"""
        self._since, self._done = 0.0, -1  # start of the steps of this length; steps before the present one

    @property
    def start(self) -> float:
        """s; start of the present step."""
        return self._since + self._done * self.length

    @property
    def end(self) -> float:
        """s; end of the present step, or of the first one before it starts."""
        return self._since + (max(self._done, 0) + 1) * self.length

    def step(self, length: float) -> float:
        """Proceed to the next step, of ``length`` s; return its end in s."""
        if length == self.length:
            self._done += 1
        else:
            self._since, self._done, self.length = self._since + (self._done + 1) * self.length, 0, length
        return self._since + (self._done + 1) * length


def publish_nothing(topic: Topic[Any], message: Any) -> None:
    """Discard a message."""


def _in_hand(vehicle: SimulatedVehicle, scenario: Scenario) -> Plant:
    """Return the bodies as the launcher supports them, facing the wind."""
    plant, throw = Plant(vehicle), scenario.throw
    plant.y[3:7] = quaternion_from_euler(throw.bank, vehicle.launch.pitch + throw.pitch, scenario.wind_from)
    return plant


def _sensors(plant: Plant, scenario: Scenario, rate: float) -> SensorSuite:
    """Build all sensors of a plant at ``rate`` in Hz; a transmitter that will be lost has a pilot."""
    pilot = scenario.pilot
    if pilot is None and any(fault.name == "receiver_lost" for fault in scenario.faults):
        pilot = standing_by
    spec = sensor_spec(plant.vehicle.sections)
    return SensorSuite(spec, scenario.seed, scenario.home, scenario.sensor_corner, pilot, rate, plant.observed)


class SimulatedWorld:
    """Simulated world: launch, flight and landing of a vehicle, with sensor frames and truth.

    It satisfies `sim_bridge.bridge.world.World`.
    """

    def __init__(
        self,
        vehicle: SimulatedVehicle,
        scenario: Scenario,
        publish: Publish = publish_nothing,
        rate: float = TICK_RATE,
    ) -> None:
        """Place the vehicle in the launcher, facing the wind; ``rate`` in Hz is that of the sensor ticks.

        Raises:
            InputError: seed or wind out of range, no such turbulence or fault, or bodies that make no vehicle.
        """
        if not (math.isfinite(scenario.duration) and scenario.duration > 0.0):
            raise InputError(f"duration must be above 0 s, not {scenario.duration:g}")
        wind = steady_wind(scenario.wind_speed, scenario.wind_from)
        self.vehicle = vehicle
        self.scenario = scenario
        self.plant = _in_hand(vehicle, scenario)
        self.suite = _sensors(self.plant, scenario, rate)
        self._vibration = vibration_of(vehicle, scenario.vibration, scenario.seed, 1.0 / rate)
        if scenario.vibration > 0.0:
            make_unequal(self.plant, vehicle, scenario.vibration)
            self.suite.field_per_ampere[:] = field_per_ampere(vehicle, scenario.vibration)
            self.suite.current_ripple[0] = scenario.vibration * vehicle.sections["vibration"].current_ripple
        push = scenario.throw.speed * vehicle.launch.speed / vehicle.launch.duration
        turbulence = dryden.turbulence(scenario.turbulence, 2.0 * vehicle.wing.semispan, scenario.seed)
        self.inputs = PlantInputs(self.plant, turbulence, wind, scenario.wind_from, scenario.home.altitude)
        self._truth = Truth(self.plant, self.inputs)
        self._phase = k.HELD
        self.plant.order[k.LAUNCHER], self.plant.order[k.LAUNCHER + 1] = self._phase, push
        self._publish = publish
        self._recorded = publish is not publish_nothing
        self._unrecorded = False
        self._tick = 0
        self._period = 1.0 / rate
        self._clock = StepClock(self._period)
        self.time_us = round(self._clock.end * 1e6)
        """us; end of the last step, or of the first one before it starts"""
        self._records, self._next_record_us = 0, 0
        self._launch_from = scenario.launch_time
        self._rest_since: float | None = None
        self._armed_since = math.inf if scenario.waits_for_arming else -math.inf
        self._launched_at = math.inf
        check_carried(scenario.faults, vehicle.sections)
        self.faults = FaultInjector(scenario.faults)
        """accepts further faults in flight"""

    @property
    def tick_us(self) -> int:
        """us; between two sensor frames."""
        return round(self._period * 1e6)

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude rad, longitude rad, altitude m of the launch place."""
        home = self.scenario.home
        return home.latitude, home.longitude, home.altitude

    @property
    def extra_wind(self) -> Vector:
        """m/s; NED, added to wind and turbulence; set by the caller."""
        north, east, down = self.inputs.extra_wind.tolist()
        return north, east, down

    @extra_wind.setter
    def extra_wind(self, wind: Vector) -> None:
        self.inputs.extra_wind[:] = wind

    @property
    def launched(self) -> bool:
        """Whether the vehicle has been released, or is being released."""
        return self._launched_at < math.inf

    @property
    def finished(self) -> bool:
        """Whether the vehicle is at rest on the ground, or the time limit is reached."""
        now = self.time_us * 1e-6
        resting = self._rest_since is not None and now - self._rest_since >= self.scenario.rest_time
        return resting or now >= self.scenario.duration

    def release(self) -> None:
        """Permit the launch from now on, as soon as the air is steady."""
        self._launch_from = min(self._launch_from, self.time_us * 1e-6)

    def step(self, command: ActuatorCommand) -> SensorFrame:
        """Advance one tick with constant ``command`` and read the sensors at its end; `record` publishes the truth.

        Raises:
            SimulationSilent: from the start of that fault.
            SimulationDiverged: the state became NaN; the truth is recorded first.
        """
        self._advance(command, self._period)
        try:
            return self._sample()
        except SimulationDiverged:
            self.record()
            raise

    def compile_sensors(self) -> None:
        """Have the kernels of a tick compiled, but the plant's; the world is not to be flown afterwards."""
        for _ in range(4):  # a tick has not all sensors
            self._set_inputs(NEUTRAL, self._period)
            self._unrecorded = self._recorded
            self._sample()

    def advance(self, command: ActuatorCommand, duration: float) -> Observation:
        """Advance ``duration`` s with constant ``command``; return the input of the sensors at its end.

        Raises:
            SimulationSilent: from the start of that fault.
        """
        self._advance(command, duration)
        return Observation.from_array(self.time_us, self.plant.observed)

    def sample(self, observation: Observation) -> SensorFrame:
        """Read the sensors, one sensor tick after the last time."""
        observation.fill(self.plant.observed)
        return self._sample()

    def _advance(self, command: ActuatorCommand, duration: float) -> None:
        self._set_inputs(command, duration)
        self.plant.step()
        self._watch_rest()
        self._unrecorded = self._recorded

    def _set_inputs(self, command: ActuatorCommand, duration: float) -> None:
        """Start a step: record the last one if that was not done, and set the plant's inputs."""
        if self._unrecorded:
            self.record()
        self.time_us = round(self._clock.step(duration) * 1e6)
        for text in self.faults.act(self.plant, self._tick, self.time_us * 1e-6):
            self._publish_event(Severity.WARNING, text)
        self.inputs.step(command, duration)
        if self._phase != k.FREE:
            self._watch_launcher(bool(command.armed))
            self.plant.order[k.LAUNCHER] = self._phase = self._launcher()

    def _sample(self) -> SensorFrame:
        if self._vibration is not None:
            y, (left, right) = self.plant.y, self.plant.layout.flap
            rate = self.plant.layout.rate
            flap_rate = 0.5 * (y.item(rate(left)) + y.item(rate(right)))
            self._vibration.add_to(self.plant.observed, flap_rate)
        frame = self.faults.sense(self.suite.sense(self.time_us, self._tick), self._tick)
        self._tick += 1
        return frame

    def truth(self) -> TruthState:
        """The vehicle's state at the end of the last step."""
        return self._truth.state(self.time_us, self._truth.values(), self._on_ground)

    def truth_wing(self) -> TruthWing:
        """Wings at the end of the last step; torques, current and power averaged over the step."""
        return self._truth.wing(self.time_us, self._truth.values())

    def truth_loads(self) -> TruthLoads:
        """Air loads of wings and tail near the end of the last step."""
        return self._truth.loads(self.time_us)

    @property
    def _on_ground(self) -> bool:
        return self.plant.touching or self._phase != k.FREE

    def record(self) -> None:
        """Publish the truth at the end of the last step, once; the next step does so if it was not called."""
        unrecorded, self._unrecorded = self._unrecorded, False
        if not unrecorded or self.time_us < self._next_record_us:
            return
        self._next_record_us = self.time_us + RECORD_PERIOD_US
        values = self._truth.values()
        self._publish(topics.STATE, self._truth.state(self.time_us, values, self._on_ground))
        self._publish(topics.WING, self._truth.wing(self.time_us, values))
        if self._records % 2 == 0:
            self._publish(topics.LOADS, self.truth_loads())
        self._records += 1

    def _launcher(self) -> int:
        now = self._clock.start
        if now < self._launched_at:
            return k.HELD
        return k.THROWN if now < self._launched_at + self.vehicle.launch.duration else k.FREE

    def _publish_event(self, severity: Severity, text: str) -> None:
        self._publish(topics.EVENTS, Event(self.time_us, severity, "world", text))

    def _watch_arming(self, armed: bool, now: float) -> None:
        """Track since when the vehicle is armed, and report the resulting launch state."""
        if armed == (self._armed_since < math.inf):
            return
        self._armed_since = now if armed else math.inf
        left = max(self._launch_from - now, ARMED_TIME)
        text = f"armed: launch in {left:.0f} s" if armed else "disarmed: launcher waiting"
        self._publish_event(Severity.NOTICE, text)

    def _watch_launcher(self, armed: bool) -> None:
        """Launch if the air is steady and the headwind at least the mean wind, or after the wait limits."""
        if self.launched:
            return
        now = self._clock.start
        if self.scenario.waits_for_arming:
            self._watch_arming(armed, now)
        ready = max(self._launch_from, self._armed_since + ARMED_TIME)
        if now < ready:
            return
        north, east, down = self.inputs.gust[:3].tolist()
        c, s = math.cos(self.scenario.wind_from), math.sin(self.scenario.wind_from)
        ahead, across = -(north * c + east * s), east * c - north * s
        waited = now - ready
        steady = waited >= LAUNCH_PATIENCE or max(abs(across), abs(down)) <= LAUNCH_GUST
        # A weaker headwind is acceptable; a tailwind reduces the airspeed after the launch.
        facing = self.scenario.wind_speed + ahead >= 0.0
        if (ahead >= 0.0 and steady) or (waited >= 2.0 * LAUNCH_PATIENCE and facing) or waited >= LONGEST_WAIT:
            self._launched_at = now
            if self.scenario.waits_for_arming:
                self._publish_event(Severity.NOTICE, "released by the launcher")

    def _watch_rest(self) -> None:
        if not (self.plant.touching and math.hypot(*self.plant.y[7:10].tolist()) < REST_SPEED):
            self._rest_since = None
        elif self._rest_since is None:
            self._rest_since = self.time_us * 1e-6
