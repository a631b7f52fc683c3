"""Attitude loops of ArduPlane and PX4 on the linear model: their structure, gains, margins and parameters.

Both command a body rate ``r = (setpoint - angle) / T`` and close a rate loop ``u = (P + I/s)(r - rate)`` around it;
u is 1 at the end of a surface's travel. ArduPlane (AP_FW_Controller, AC_PID) filters r and computes degrees of 45,
PX4 (fw_rate_control, fw_att_control) a torque of 1. Derivative and feed-forward gains are 0. Both scale P and I by
the square of the trim airspeed over the airspeed: the trim airspeed is that of the model.

The loop is cut at u, with both closures in it: ``L = (P + I/s)(rate + F angle / T)``, F the filter of r.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from avionics.gains import FlightGains
from avionics.vehicles import FlightVehicle
from sim_bridge.bridge.foreign.parameters import (
    Parameter,
    ardupilot_file,
    ardupilot_limits,
    px4_limits,
    qgroundcontrol_file,
)
from sim_bridge.flight.tuning import attitude
from sim_bridge.flight.tuning.aircraft import Aircraft, lateral, longitudinal, throttle_at
from sim_bridge.flight.tuning.cascade import Design
from sim_bridge.tuning import blocks
from sim_bridge.tuning.loop import LoopSpec, Process, Terms, loop_bandwidth, loop_margins, pick, search
from sim_bridge.tuning.margins import LIMITS, Margins
from sim_bridge.tuning.model import HALF_STROKE, LinearModel
from wingbeat.errors import InputError

TIME_CONSTANTS = (0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0)
"""s; candidates for T, within the range of both parameter references"""
LARGEST_GAIN = 10.0
"""-; of P and I, PX4's limit"""
LEAST_ALTITUDE_TIME = 2.0
"""s; lower limit of PX4's FW_T_ALT_TC"""


class Firmware(NamedTuple):
    """Properties of an autopilot's attitude loops, from the defaults of its parameters."""

    title: str
    delay: float
    """s; sampling, computation and hold of the servo pulse"""
    gyro_cutoff: float
    """Hz; second-order low-pass of the rate"""
    setpoint_cutoff: float
    """Hz; first-order low-pass of the rate setpoint, 0 without one"""
    output: float
    """-; u per rad/s of the rate controller's output"""
    names: dict[str, tuple[str, str, str]]
    """-; parameters of T, P and I by axis"""
    parameters: Callable[[LinearModel, FlightGains, Design, Iterable[AxisLoop]], list[Parameter]]
    file: Callable[[str, Iterable[Parameter]], str]


class AxisLoop(NamedTuple):
    """Designed loop of one axis."""

    name: str
    """-; pitch or roll"""
    time_constant: float
    """s"""
    proportional: float
    """u per rad/s, by the firmware's own scale"""
    integral: float
    """u per rad, likewise"""
    travel: float
    """rad; surface at u = 1"""
    margins: Margins
    bandwidth: float
    """rad/s; -3 dB from the angle setpoint to the angle"""
    gains: dict[str, float]
    """-; designed values by parameter name"""


def design_axes(firmware: Firmware, model: LinearModel, vehicle: FlightVehicle) -> list[AxisLoop]:
    """Design pitch, and roll if the model has lateral motion.

    Raises:
        InputError: no gains of an axis meet the margins.
    """
    aircraft = Aircraft(model, vehicle.airframe, vehicle.gains)
    axes = [("pitch", elevator_travel(vehicle.gains))]
    if model.lateral is not None:
        axes.append(("roll", abs(vehicle.gains.tail.rudder_share)))
    return [_designed(firmware, aircraft, name, travel) for name, travel in axes]


def elevator_travel(gains: FlightGains) -> float:
    """Return the elevator travel (rad) at full output: the larger of both sides of the trim."""
    trim = gains.pitch.elevator_trim
    return max(gains.tail.elevator_max - trim, trim - gains.tail.elevator_min)


def axis_process(firmware: Firmware, aircraft: Aircraft, axis: str, time_constant: float) -> Process:
    """Build the process of a loop from the rate controller's output to `L / (P + I/s)`."""
    if axis == "pitch":
        plant, surface = longitudinal(aircraft), "elevator"
        scale = firmware.output * elevator_travel(aircraft.gains)
    else:
        plant, surface, scale = lateral(aircraft), "roll_command", firmware.output
    parts = [
        plant,
        blocks.gain(scale, "output", "surface"),
        blocks.delay(firmware.delay, "surface", surface),
        _low_pass(firmware.gyro_cutoff, f"{axis}_rate", "measured"),
        blocks.gain(1.0 / time_constant, axis, "rate_setpoint"),
        blocks.lag(_lag(firmware.setpoint_cutoff), "rate_setpoint", "answer"),
        blocks.gain(1.0, "answer", "measured"),
    ]
    whole = blocks.joined(parts, ["output"], ["measured", "answer"])
    return Process(pick(whole, "output", "answer"), pick(whole, "output", "measured", "measured"))


def _lag(cutoff: float) -> float:
    return 1.0 / (2.0 * math.pi * cutoff) if cutoff > 0.0 else 0.0


def _low_pass(cutoff: float, source: str, target: str) -> Any:
    """Build a second-order Butterworth low-pass."""
    import control

    w = 2.0 * math.pi * cutoff
    filtered = control.tf([w * w], [1.0, math.sqrt(2.0) * w, w * w])
    return control.ss(filtered, inputs=[source], outputs=[target], name=f"filter of {source}")


def _designed(firmware: Firmware, aircraft: Aircraft, axis: str, travel: float) -> AxisLoop:
    """Choose the time constant and gains with the largest bandwidth."""
    spec = LoopSpec(
        attitude.SHARE * aircraft.model.flapping_rate, True, False, (LARGEST_GAIN, LARGEST_GAIN, math.inf)
    )
    found = []
    for time_constant in TIME_CONSTANTS:
        process = axis_process(firmware, aircraft, axis, time_constant)
        try:
            terms = search(process, spec)
        except InputError:
            continue
        rounded = Terms(*(float(f"{value:.3g}") for value in terms))
        found.append((loop_bandwidth(process, rounded), time_constant, process, rounded))
    # Margins take as long as a search: they are computed of the fastest loops alone.
    for speed, time_constant, process, rounded in sorted(found, key=lambda loop: loop[0], reverse=True):
        margins = loop_margins(process, rounded)
        if margins.keeps(LIMITS):
            gains = dict(zip(firmware.names[axis], (time_constant, *rounded[:2]), strict=True))
            return AxisLoop(axis, time_constant, *rounded[:2], travel, margins, speed, gains)
    raise InputError(
        f"{axis}: no gains give the loop of {firmware.title} {LIMITS.gain_margin_db:g} dB and"
        f" {math.degrees(LIMITS.phase_margin):.0f} degrees below {spec.fastest:.3g} rad/s"
    )


# --- parameters -----------------------------------------------------------------------------------------------


def _tuned(loop: AxisLoop, units: tuple[str, str, str]) -> list[Parameter]:
    margins = loop.margins
    source = f"tuned: GM {margins.gain_db:.1f} dB, PM {math.degrees(margins.phase):.0f} deg"
    return [
        Parameter(name, value, unit, source) for (name, value), unit in zip(loop.gains.items(), units, strict=True)
    ]


def _altitude_time(design: Design) -> list[float]:
    """Return the time constant of the altitude error (s), 1 / altitude.proportional, if it was designed."""
    values = design.values
    if "altitude.proportional" not in values:
        return []
    return [max(LEAST_ALTITUDE_TIME, float(f"{1.0 / values['altitude.proportional']:.2g}"))]


def _throttle(model: LinearModel, gains: FlightGains) -> list[float]:
    """Return the throttle of the trim, if the model has a drive."""
    if model.drive is None:
        return []
    at = model.drive.at
    return [round(throttle_at(gains.flapping, at) if model.drive.input == HALF_STROKE else at, 3)]


ALTITUDE_SOURCE = f"1 / altitude.proportional of wingbeat tune; at least {LEAST_ALTITUDE_TIME:g} s"
ONE_SURFACE = "chosen: the roll output alone moves the rudder"
SPEED_SOURCE = "airspeed of the model's trim"


def _ardupilot(model: LinearModel, gains: FlightGains, design: Design, loops: Iterable[AxisLoop]) -> list[Parameter]:
    result = []
    for loop in loops:
        rate = {"pitch": "PTCH_RATE", "roll": "RLL_RATE"}[loop.name]
        result += [
            *_tuned(loop, ("s", "rad/(rad/s), servo end is 45 deg", "rad/rad, likewise")),
            Parameter(f"{rate}_D", 0.0, "-", "the design has no derivative term"),
            Parameter(f"{rate}_FF", 0.0, "-", "the design has no feed-forward"),
            Parameter(f"{rate}_FLTT", ARDUPLANE.setpoint_cutoff, "Hz", "default, part of the design"),
        ]
    speed = float(f"{model.airspeed:.3g}")
    return [
        *result,
        Parameter("INS_GYRO_FILTER", round(ARDUPLANE.gyro_cutoff), "Hz", "default, part of the design"),
        Parameter("KFF_RDDRMIX", 0.0, "-", ONE_SURFACE),
        Parameter("SCALING_SPEED", speed, "m/s", SPEED_SOURCE),
        Parameter("AIRSPEED_CRUISE", speed, "m/s", SPEED_SOURCE),
        Parameter("AIRSPEED_MAX", gains.excitation.airspeed_max, "m/s", "excitation.airspeed_max"),
        *ardupilot_limits(gains),
        Parameter("TECS_CLMB_MAX", gains.altitude.climb_max, "m/s", "altitude.climb_max"),
        *(Parameter("TRIM_THROTTLE", round(100.0 * value), "%", "model: drive at the trim") for value in
          _throttle(model, gains)),
        *(Parameter("TECS_TIME_CONST", value, "s", ALTITUDE_SOURCE) for value in _altitude_time(design)),
    ]  # fmt: skip


def _px4(model: LinearModel, gains: FlightGains, design: Design, loops: Iterable[AxisLoop]) -> list[Parameter]:
    result = []
    for loop in loops:
        rate = {"pitch": "FW_PR", "roll": "FW_RR"}[loop.name]
        result += [
            *_tuned(loop, ("s", "1/(rad/s), servo end is 1", "1/rad, likewise")),
            Parameter(f"{rate}_D", 0.0, "-", "the design has no derivative term"),
            Parameter(f"{rate}_FF", 0.0, "-", "the design has no feed-forward"),
        ]
    speed = float(f"{model.airspeed:.3g}")
    return [
        *result,
        *(Parameter(f"FW_YR_{term}", 0.0, "-", ONE_SURFACE) for term in ("P", "I", "D", "FF")),
        Parameter("IMU_GYRO_CUTOFF", PX4.gyro_cutoff, "Hz", "default, part of the design"),
        Parameter("FW_ARSP_SCALE_EN", 1, "-", "default, part of the design"),
        Parameter("FW_AIRSPD_TRIM", speed, "m/s", SPEED_SOURCE),
        Parameter("FW_AIRSPD_MAX", gains.excitation.airspeed_max, "m/s", "excitation.airspeed_max"),
        *px4_limits(gains),
        Parameter("FW_T_CLMB_MAX", gains.altitude.climb_max, "m/s", "altitude.climb_max"),
        *(Parameter("FW_THR_TRIM", value, "-", "model: drive at the trim") for value in _throttle(model, gains)),
        *(Parameter("FW_T_ALT_TC", value, "s", ALTITUDE_SOURCE) for value in _altitude_time(design)),
    ]


ARDUPLANE = Firmware(
    "ArduPlane", 1.5 / 50.0, 20.0, 3.0, math.degrees(1.0) / 45.0,
    {
        "pitch": ("PTCH2SRV_TCONST", "PTCH_RATE_P", "PTCH_RATE_I"),
        "roll": ("RLL2SRV_TCONST", "RLL_RATE_P", "RLL_RATE_I"),
    },
    _ardupilot, ardupilot_file,
)  # fmt: skip
"""50 Hz: SCHED_LOOP_RATE and servo pulses; PTCH_RATE_FLTT and RLL_RATE_FLTT are 3 Hz"""
PX4 = Firmware(
    "PX4", 1.5 / 250.0 + 0.5 / 50.0, 40.0, 0.0, 1.0,
    {"pitch": ("FW_P_TC", "FW_PR_P", "FW_PR_I"), "roll": ("FW_R_TC", "FW_RR_P", "FW_RR_I")},
    _px4, qgroundcontrol_file,
)  # fmt: skip
"""attitude at 250 Hz, servo pulses at 50 Hz"""
FIRMWARE = {"ardupilot": ARDUPLANE, "px4": PX4}
