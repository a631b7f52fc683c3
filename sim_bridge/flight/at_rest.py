"""A vehicle that lies level on a table: its sensors with their noise and errors, and no physics."""

from __future__ import annotations

from avionics.messages import ActuatorCommand, SensorFrame
from sim_bridge.flight.world import TICK, Scenario
from sim_bridge.messages import TruthState
from sim_bridge.observation import Observation
from sim_bridge.sensors.suite import SensorSuite, sensor_spec
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.atmosphere import isa
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.quaternions import quaternion_from_euler


class AtRest:
    """Vehicle at rest on a table, a `sim_bridge.bridge.world.World`; commands have no effect on wings and tail."""

    def __init__(self, vehicle: SimulatedVehicle, scenario: Scenario) -> None:
        """Place the vehicle with its nose into the scenario's wind.

        Raises:
            InputError: a sensor is missing in the vehicle's file, or the seed is negative.
        """
        self.scenario = scenario
        self.suite = SensorSuite(
            sensor_spec(vehicle.sections), scenario.seed, scenario.home, scenario.sensor_corner, scenario.pilot
        )
        self._ticks = 0
        self._at_rest = _observation(vehicle, scenario)

    @property
    def tick_us(self) -> int:
        """us; between two sensor frames."""
        return round(TICK * 1e6)

    @property
    def origin(self) -> tuple[float, float, float]:
        """Latitude rad, longitude rad, altitude m of the vehicle."""
        home = self.scenario.home
        return home.latitude, home.longitude, home.altitude

    @property
    def time_us(self) -> int:
        """us; of the last frame."""
        return self._ticks * self.tick_us

    @property
    def finished(self) -> bool:
        """Whether the time limit is reached."""
        return self.time_us >= self.scenario.duration * 1e6

    def step(self, command: ActuatorCommand) -> SensorFrame:
        """Return the sensor readings of the next tick."""
        self._ticks += 1
        observation = self._at_rest._replace(time_us=self.time_us)
        return self.suite.sample(observation, self._ticks - 1)

    def record(self) -> None:
        """Do nothing: the truth is constant and not recorded."""

    def truth(self) -> TruthState:
        """Return the true state: level and at rest."""
        nothing = (0.0,) * 6
        wind = (0.0, 0.0, 0.0)
        return TruthState._make(
            (self.time_us, *nothing, *self._at_rest.quaternion, 0.0, 0.0, 0.0, *wind, 0.0, 0.0, 1)
        )


def _observation(vehicle: SimulatedVehicle, scenario: Scenario) -> Observation:
    air = isa(scenario.home.altitude)
    w, x, y, z = (float(value) for value in quaternion_from_euler(0.0, 0.0, scenario.wind_from))
    still = (0.0, 0.0, 0.0)
    return Observation(
        time_us=0,
        quaternion=(w, x, y, z),
        omega_frd=still,
        specific_force_frd=(0.0, 0.0, -STANDARD_GRAVITY),
        position_ned=still,
        v_ned=still,
        v_air_frd=still,
        static_pressure=air.pressure,
        temperature=air.temperature,
        density=air.density,
        flap_left=0.0,
        flap_right=0.0,
        torque_left=0.0,
        torque_right=0.0,
        current=0.0,
        open_circuit_voltage=vehicle.battery.full_voltage,
        battery_resistance=vehicle.battery.resistance,
        pulse_current=vehicle.drive.pulse_current,
        pwm_frequency=vehicle.drive.pwm_frequency,
    )
