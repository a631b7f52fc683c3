"""Flights in this process: simulate, record, read."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from avionics.autopilot import Autopilot
from logs.campaigns.prepared import Prepared, prepare
from logs.campaigns.single_flight import recorded
from logs.campaigns.stock import load_stock
from logs.columns import Columns
from logs.names import reserved
from logs.new_files import check_new
from logs.reader import Log, open_log
from logs.summary import FlightSummary, summarize
from sim_bridge.flight.flight import fly as fly_in_process
from sim_bridge.flight.world import SimulatedWorld
from sim_bridge.plant import physics_compiled
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Flight", "fly", "open_log"]

DEFAULT_VEHICLE, DEFAULT_MISSION = "robo_raven_ii_d", "circuit"


class Flight:
    """A recorded flight: its log, its summary, its topics as columns."""

    def __init__(self, log: Log) -> None:
        self.log = log
        self._summary: FlightSummary | None = None

    @property
    def path(self) -> Path:
        """The MCAP file."""
        return self.log.path

    @property
    def summary(self) -> FlightSummary:
        """Key figures such as airtime, altitude hold, energy and touchdown."""
        if self._summary is None:
            self._summary = summarize(self.log)
        return self._summary

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the recorded topics."""
        return tuple(self.log.topics)

    def __getitem__(self, topic: str) -> Columns:
        """Read a topic as columns.

        Raises:
            InputError: the log has no such topic.
        """
        return self.log.columns(topic)

    def plot(self) -> Figure:
        """Plot altitude, airspeed, attitude, flapping frequency and power over time (needs matplotlib)."""
        from wingbeat.api.plots import plot_flight

        return plot_flight(self.log)

    def __repr__(self) -> str:
        found = self.summary
        air = "not in the air" if found.airtime is None else f"{found.airtime:.1f} s in the air"
        far = "" if found.distance is None else f", {found.distance:.0f} m"
        end = "" if found.touchdown is None else f", landed at {found.touchdown.sink:.1f} m/s sink rate"
        return f"Flight {self.path}: {air}{far}{end}; {len(self.log.topics)} topics"


def fly(
    vehicle: str | Path = DEFAULT_VEHICLE,
    mission: str | Path = DEFAULT_MISSION,
    *,
    wind: float = 0.0,
    wind_from_deg: float = 0.0,
    turbulence: str = "none",
    vibration: float | None = None,
    seed: int = 1,
    duration: float = 300.0,
    aerodynamics: str | None = None,
    faults: Sequence[str] = (),
    gains: Mapping[str, float] | None = None,
    changes: Mapping[str, Any] | None = None,
    log: Path | str | None = None,
) -> Flight:
    """Simulate a flight with the flight computer in the loop and record it.

    World and flight computer run in this process; the flight is the one of ``wingbeat fly`` with the same inputs.

    Args:
        vehicle: name or folder.
        mission: name or file (.toml, .plan, .waypoints).
        wind: m/s, steady.
        wind_from_deg: direction the wind comes from, clockwise from north.
        turbulence: Dryden gusts: none, light, moderate, severe, small_uav_light, small_uav_moderate.
        vibration: factor of the vibration of the vehicle file; 0: none (default: 1 if the file has a vibration).
        seed: of sensor noise and gusts; the same inputs give the same flight.
        duration: s, at most.
        aerodynamics: model of the wings (default: that of the vehicle file).
        faults: such as ``gps_lost@30-50``.
        gains: flight computer parameters, such as ``{"pitch.damping": 0.2}``.
        changes: vehicle keys, such as ``{"bodies.fuselage.mass": 0.30}``.
        log: new MCAP file (default: ``recordings/VEHICLE-TIME.mcap``).

    Raises:
        InputError: an argument that is not valid, or a log that exists or cannot be written.
    """
    prepared = prepared_flight(
        vehicle, mission, wind=wind, wind_from_deg=wind_from_deg, turbulence=turbulence, vibration=vibration,
        seed=seed, duration=duration,
        aerodynamics=aerodynamics, faults=faults, gains=gains, changes=changes,
    )  # fmt: skip
    with _log_path(log, str(vehicle)) as path:
        _fly_to(path, prepared)
        return Flight(open_log(path))


def prepared_flight(
    vehicle: str | Path,
    mission: str | Path,
    *,
    wind: float = 0.0,
    wind_from_deg: float = 0.0,
    turbulence: str = "none",
    vibration: float | None = None,
    seed: int = 1,
    duration: float = 300.0,
    aerodynamics: str | None = None,
    faults: Sequence[str] = (),
    gains: Mapping[str, float] | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Prepared:
    """Return the vehicle, flight computer, mission and scenario of a flight; arguments as `fly`.

    Raises:
        InputError: an argument that is not valid.
    """
    values: dict[str, Any] = {
        "vehicle": str(vehicle), "mission": str(mission), "seed": seed, "duration": duration,
        "turbulence": turbulence, "faults": " ".join(faults), "wind.speed": wind,
        "wind.from": math.radians(wind_from_deg),
    }  # fmt: skip
    if vibration is not None:
        if isinstance(vibration, str):
            raise InputError(f"vibration must be a factor, 0 for none, not {vibration!r}")
        values["vibration"] = vibration
    if aerodynamics is not None:
        values["aerodynamics"] = aerodynamics
    values |= {f"gains.{key}": value for key, value in (gains or {}).items()}
    values |= {f"vehicle.{key}": value for key, value in (changes or {}).items()}
    return prepare(load_stock(Path.cwd(), [str(vehicle)], [str(mission)], []), values)


@contextmanager
def _log_path(log: Path | str | None, vehicle: str) -> Iterator[Path]:
    if log is None:
        with reserved(vehicle) as path:
            yield path
        return
    check_new(Path(log))
    yield Path(log)


def compile_physics(vehicle: SimulatedVehicle) -> None:
    """Compile the physics by two processes if the cache lacks them, with progress on stderr."""
    if not physics_compiled():
        from groundstation.command.compiling import load_physics

        load_physics(vehicle)


def _fly_to(path: Path, flight: Prepared) -> None:
    compile_physics(flight.vehicle)
    with recorded(path, flight) as publish:
        world = SimulatedWorld(flight.vehicle, flight.scenario, publish)
        fly_in_process(world, Autopilot(flight.computer, flight.plan.mission, publish), flight.commands)
