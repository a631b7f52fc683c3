"""What a flight's log gives of the short period and the servo, beside the truth."""

from __future__ import annotations

from typing import NamedTuple

from memory_log import MemoryLog

from avionics import topics
from avionics.vehicles import load_vehicle as load_flight_vehicle
from logs.attached import airframe_of, gauges_of
from logs.identification.data.flight import Aircraft
from logs.identification.models.modes import Mode
from logs.identification.report import identify
from sim_bridge import topics as truth_topics
from sim_bridge.flight_mechanics.averaged import ShortPeriod, short_period_of, stroke_averaged_model
from sim_bridge.flight_mechanics.orbit import trim
from sim_bridge.vehicles import load_vehicle

INPUTS_OVER = 83.0
"""s; the circuit's doublets are flown by then"""


class Result(NamedTuple):
    true: ShortPeriod
    modes: tuple[Mode, ...]
    agree: bool | None
    torque: dict[str, tuple[float, float, float]]


def true_short_period(vehicle: str, log: MemoryLog) -> ShortPeriod:
    """Of the vehicle linearised about the mean true flight condition of the inputs."""
    excitation, state = log.columns(topics.EXCITATION), log.columns(truth_topics.STATE)
    active = excitation["time_us"][excitation["active"] > 0]
    during = (state["time_us"] >= active[0]) & (state["time_us"] <= active[-1])
    airspeed, climb = float(state["airspeed"][during].mean()), -float(state["v_down"][during].mean())
    world = load_vehicle(vehicle)
    return short_period_of(stroke_averaged_model(world, trim(world, airspeed, climb)))


def known(vehicle: str) -> Aircraft:
    """What is known of the aircraft by its files, the accuracy of its gauges too."""
    world = load_vehicle(vehicle)
    return airframe_of(load_flight_vehicle(vehicle), world)._replace(gauges=gauges_of(world))


def identified(vehicle: str, log: MemoryLog) -> Result:
    found = identify(log, "all", known(vehicle))
    assert found.modes is not None
    assert found.torque is not None
    torque = {e.name: (e.value, e.low, e.high) for e in found.torque.estimates}
    return Result(true_short_period(vehicle, log), found.modes.modes, found.modes.agree, torque)
