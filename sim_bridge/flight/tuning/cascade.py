"""The whole cascade, designed from inside out, each loop with those inside it closed as they were designed."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from avionics.gains import FlightGains
from avionics.vehicles import FlightVehicle
from sim_bridge.flight.tuning import altitude, climb, heading, pitch, roll, tail_check
from sim_bridge.flight.tuning.aircraft import Aircraft
from sim_bridge.tuning.loop import Process, Terms, loop_bandwidth, loop_margins
from sim_bridge.tuning.margins import Margins
from sim_bridge.tuning.model import LinearModel
from wingbeat.errors import InputError


class Part(NamedTuple):
    """Loop of the cascade."""

    name: str
    """-; display name"""
    keys: tuple[str, ...]
    """-; keys of the vehicle file that it determines: section.key"""
    process: Callable[[Aircraft], Process]
    terms: Callable[[Aircraft], Terms]
    tuned: Callable[[Aircraft], Aircraft]
    lateral: bool = False
    """-; whether it needs the model's lateral motion"""
    drive: bool = False
    """-; whether it needs the model's drive"""


PARTS = (
    Part("pitch", ("pitch.proportional", "pitch.integral", "pitch.damping", "pitch.airspeed"),
         pitch.process, pitch.terms, pitch.tuned),
    Part("roll", ("roll.proportional", "roll.integral", "roll.damping", "roll.airspeed"),
         roll.process, roll.terms, roll.tuned, lateral=True),
    Part("climb", ("altitude.throttle_error", "altitude.throttle_integral"), climb.process,
         lambda aircraft: climb.terms(aircraft.gains.altitude), climb.tuned, drive=True),
    Part("altitude", ("altitude.proportional",), altitude.process,
         lambda aircraft: altitude.terms(aircraft.gains.altitude), altitude.tuned, drive=True),
    Part("heading", ("heading.proportional",), heading.process,
         lambda aircraft: heading.terms(aircraft.gains.heading), heading.tuned, lateral=True),
)  # fmt: skip


class Loop(NamedTuple):
    """One loop with one set of gains."""

    name: str
    gains: dict[str, float]
    """gains by section.key"""
    margins: Margins
    bandwidth: float
    """rad/s; -3 dB from the setpoint to the controlled variable; 0 for an unstable loop"""


class Design(NamedTuple):
    """Result of tuning a vehicle."""

    model: LinearModel
    gains: FlightGains
    """gains with the designed ones included"""
    before: tuple[Loop, ...]
    """loops with the gains of the file"""
    after: tuple[Loop, ...]
    """loops with the designed gains, in the same order"""

    @property
    def values(self) -> dict[str, float]:
        """Return the designed gains and the parameters of the tail check by section.key."""
        loops = {key: value for loop in self.after for key, value in loop.gains.items()}
        return loops | {key: value_of(self.gains, key) for key in tail_check.KEYS}


def design(
    model: LinearModel, vehicle: FlightVehicle, on_progress: Callable[[int, int], None] = lambda done, of: None
) -> Design:
    """Design every loop that the model supports; ``on_progress`` gets the loops done and their number.

    Raises:
        InputError: no gains of a loop meet the margins.
    """
    start = Aircraft(model, vehicle.airframe, vehicle.gains)
    parts = parts_of(model)
    aircraft = start
    for i, part in enumerate(parts):
        try:
            aircraft = _rounded(part.tuned(aircraft), part)
        except InputError as error:
            raise InputError(f"{part.name}: {error}") from None
        on_progress(i + 1, len(parts))
    before, after = (tuple(examined(part, one) for part in parts) for one in (start, aircraft))
    return Design(model, tail_check.tuned(model, aircraft.gains), before, after)


def parts_of(model: LinearModel) -> tuple[Part, ...]:
    """Return the loops that the model supports."""
    missing = (model.lateral is None, model.drive is None)
    return tuple(part for part in PARTS if not (part.lateral and missing[0]) and not (part.drive and missing[1]))


def examined(part: Part, aircraft: Aircraft) -> Loop:
    """Analyze a loop with the gains of the aircraft."""
    process, terms = part.process(aircraft), part.terms(aircraft)
    found = loop_margins(process, terms)
    speed = loop_bandwidth(process, terms) if found.stable else 0.0
    return Loop(part.name, {key: value_of(aircraft.gains, key) for key in part.keys}, found, speed)


def value_of(gains: FlightGains, key: str) -> float:
    """Return the gain of section.key."""
    section, name = key.split(".")
    return float(getattr(getattr(gains, section), name))


def _rounded(aircraft: Aircraft, part: Part) -> Aircraft:
    """Round the gains of the loop to three digits, as in the file."""
    gains = aircraft.gains
    for key in part.keys:
        section, name = key.split(".")
        value = float(f"{value_of(gains, key):.3g}")
        gains = gains._replace(**{section: getattr(gains, section)._replace(**{name: value})})
    return aircraft._replace(gains=gains)
