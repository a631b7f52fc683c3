"""Vehicle, flight computer, plan and scenario from the values of a flight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from avionics import parameters
from avionics.gains import FlightGains
from avionics.guidance.mission import FlightPlan
from avionics.messages import Command
from avionics.missions.script import plan_commands, scripted_start
from avionics.vehicles import FlightVehicle
from logs.campaigns.keys import Values, of_family, plain
from logs.campaigns.stock import DEFAULT_MISSION, DEFAULT_VEHICLE, Stock
from logs.campaigns.vehicle_values import altered
from logs.replay.flight import changed, place_of
from sim_bridge.environment import dryden
from sim_bridge.environment.wind import steady_wind
from sim_bridge.flight.faults import Fault, checked, parse_fault
from sim_bridge.flight.world import Scenario, Throw
from sim_bridge.mechanism import build_mechanism
from sim_bridge.sensors.transmitter import Script
from sim_bridge.vehicles import SimulatedVehicle, with_model
from sim_bridge.vibration.flight import vibration_factor
from wingbeat.errors import InputError

DURATION = 300.0
"""s; default time limit of a flight, as of ``wingbeat fly``"""


class Prepared(NamedTuple):
    """Flight that is ready to start."""

    vehicle: SimulatedVehicle
    computer: FlightVehicle
    plan: FlightPlan
    scenario: Scenario
    commands: tuple[Command, ...]
    """commands at fixed ticks; the scenario has the faults that are inputs of the flight"""
    sticks: Script | None = None
    """transmitter inputs, instead of the scripted start"""


def prepare(stock: Stock, values: Values) -> Prepared:
    """Prepare a flight from its values.

    Raises:
        InputError: invalid value.
    """
    pair = stock.vehicles[plain(values, "vehicle", DEFAULT_VEHICLE)]
    planned = stock.missions[plain(values, "mission", DEFAULT_MISSION)]
    sticks = stock.sticks[values["sticks"]] if "sticks" in values else None
    scale = of_family(values, "scale")
    vehicle = _vehicle(pair.world, values, of_family(scale, "vehicle"))
    gains = _gains(pair.computer.gains, of_family(values, "gains"), of_family(scale, "gains"))
    scenario = _scenario(values, planned.faults, sticks)
    factor = float(values["vibration"]) if "vibration" in values else None
    scenario = scenario._replace(vibration=vibration_factor(vehicle, factor))
    dryden.turbulence(scenario.turbulence, 2.0 * vehicle.wing.semispan, scenario.seed)
    start = scripted_start() if sticks is None else ()
    commands = (*plan_commands(planned.plan), *start)
    return Prepared(vehicle, pair.computer._replace(gains=gains), planned.plan, scenario, commands, sticks)


def _vehicle(world: SimulatedVehicle, values: Values, factors: Mapping[str, Any]) -> SimulatedVehicle:
    vehicle = altered(world, of_family(values, "vehicle"), factors)
    if "aerodynamics" in values:
        vehicle = with_model(vehicle, values["aerodynamics"])
    build_mechanism(vehicle)
    return vehicle


def _gains(gains: FlightGains, values: Mapping[str, Any], factors: Mapping[str, Any]) -> FlightGains:
    for key, value in values.items():
        _parameter(gains, f"gains.{key}", key)
        gains = _changed(gains, f"gains.{key}", key, value)
    for key, factor in factors.items():
        value = parameters.get(gains, _parameter(gains, f"scale.gains.{key}", key)) * factor
        gains = _changed(gains, f"scale.gains.{key}", key, value)
    return gains


def _parameter(gains: FlightGains, name: str, key: str) -> parameters.Parameter:
    """Return the gain of a key, ``pitch.damping`` or a parameter name.

    Raises:
        InputError: the flight computer has none such; one line with those that it has beside it.
    """
    table = parameters.parameter_table(gains)
    places = {place_of(parameter): parameter for parameter in table.values()}
    found = places.get(key) or table.get(key.upper())
    if found is not None:
        return found
    section = key.partition(".")[0]
    beside = [place.partition(".")[2] for place in places if place.partition(".")[0] == section]
    known = f"{section} has {', '.join(beside)}" if beside else f"sections: {', '.join(gains._fields)}"
    raise InputError(f"{name}: the flight computer has no such gain; {known}")


def _changed(gains: FlightGains, name: str, key: str, value: Any) -> FlightGains:
    if not isinstance(value, int | float):
        raise InputError(f"{name} must be a number: of a list, each by its place, such as {key}[0]")
    try:
        return changed(gains, {key: value})
    except InputError as error:
        raise InputError(f"{name}: {error}") from None


def _scenario(values: Values, of_mission: tuple[Fault, ...], sticks: Script | None) -> Scenario:
    duration = float(plain(values, "duration", DURATION))
    if not 0.0 < duration < math.inf:
        raise InputError(f"duration must be above 0 s, not {duration:g}")
    faults = (*_faults(values), *of_mission)
    for fault in faults:
        if fault.at >= duration:
            raise InputError(f"fault {fault.name} at {fault.at:g} s: the flight ends at {duration:g} s at the latest")
    speed, wind_from = float(plain(values, "wind.speed", 0.0)), float(plain(values, "wind.from", 0.0))
    steady_wind(speed, wind_from)
    return Scenario(
        seed=plain(values, "seed", 1),
        wind_speed=speed,
        wind_from=wind_from,
        turbulence=plain(values, "turbulence", "none"),
        duration=duration,
        throw=Throw(*(float(plain(values, f"throw.{n}", d)) for n, d in Throw._field_defaults.items())),
        sensor_corner=float(plain(values, "sensors.corner", 0.0)),
        pilot=None if sticks is None else sticks.pilot(),
        faults=faults,
        waits_for_arming=True,
    )


def _faults(values: Values) -> list[Fault]:
    """Return the faults given as text, then those whose times have keys of their own.

    Raises:
        InputError: no such fault, no beginning, or times that cannot be.
    """
    told = [parse_fault(text) for text in plain(values, "faults", "").split()]
    times: dict[str, dict[str, float]] = {}
    for place, value in of_family(values, "fault").items():
        name, _, end = place.rpartition(".")
        if end not in ("at", "until", "lasting"):
            raise InputError(f"fault.{place}: only fault.NAME.at, .until and .lasting are known")
        times.setdefault(name, {})[end] = float(value)
    return [*told, *(_timed(name, ends) for name, ends in times.items())]


def _timed(name: str, ends: Mapping[str, float]) -> Fault:
    if "at" not in ends or {"until", "lasting"} <= set(ends):
        raise InputError(f"fault.{name} needs fault.{name}.at, and either .until, .lasting or neither")
    begin = ends["at"]
    return checked(Fault(name, begin, ends.get("until", begin + ends.get("lasting", math.inf))))
