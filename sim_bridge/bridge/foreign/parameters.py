"""Parameters with which ArduPlane and PX4 fly a vehicle of this world, and the files that they load.

Names, units and meanings are those of their parameter references. The gains of their attitude loops are those of
`sim_bridge.flight.tuning.autopilots`.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable
from typing import NamedTuple

from avionics.gains import FlightGains
from avionics.vehicles.loader import FlightVehicle
from sim_bridge.bridge.foreign.launch import Push
from sim_bridge.bridge.foreign.outputs import Channels, Pulses
from wingbeat.errors import InputError

LINE_LENGTH = 98
"""characters; ArduPilot's limit of a line in a parameter file, beyond which it is split"""
PX4_OUTPUTS = 16
"""-; of HIL_ACTUATOR_CONTROLS"""
ARDUPILOT_OUTPUTS = 16
"""-; without SERVO_32_ENABLE"""
DETECTION_TIME = 0.05
"""s; above the threshold, before PX4 detects a launch"""
ARDUPILOT_FUNCTIONS = Channels(4, 19, 70, 21)
"""SERVOn_FUNCTION of aileron, elevator, throttle, rudder"""
PX4_FUNCTIONS = Channels(201, 202, 101, 203)
"""PWM_MAIN_FUNCn of aileron (surface 0), elevator (surface 1), throttle (motor 1), rudder (surface 2)"""
PX4_SURFACES = ((15, (1, 0, 0)), (3, (0, 1, 0)), (4, (0, 0, 1)))
"""CA_SV_CSn_TYPE (single-channel aileron, elevator, rudder) and torque by axis"""
PX4_AIRFRAME_OUTPUTS = range(1, 10)
"""outputs assigned by airframe 1030"""
DEGREE = "deg"
PARAM_INT32, PARAM_REAL32 = 6, 9
"""MAV_PARAM_TYPE"""
AIRSPEED_SOURCE = "trim: fastest level flight; at most excitation.airspeed_max"
CLIMB_SOURCE = "trim at the cruise; at most altitude.climb_max"


class Parameter(NamedTuple):
    """Parameter of a foreign autopilot."""

    name: str
    value: float
    unit: str
    source: str
    """source of the value"""

    @property
    def text(self) -> str:
        """Format the value as in the files: an integer without a decimal point."""
        return str(self.value) if isinstance(self.value, int) else f"{self.value:.4g}"


class Performance(NamedTuple):
    """Performance of the simulated vehicle from its trim, with the outputs of the flight vehicle's mixer."""

    cruise_airspeed: float
    """m/s; of the trim"""
    max_airspeed: float
    """m/s; fastest level trim within the throttle"""
    climb_rate: float
    """m/s; largest of the trims at the cruise airspeed"""
    throttle: float
    """-; of level flight at the cruise airspeed"""
    pitch: float
    """rad; likewise"""
    elevator: float
    """-; likewise, output from -1 to 1"""


class Subject(NamedTuple):
    """Data for a parameter file."""

    vehicle: FlightVehicle
    performance: Performance
    channels: Channels
    pulses: Pulses
    push: Push | None
    """launch that the autopilot has to detect; None if the launcher acts on the throttle"""


def check_outputs(channels: Channels, of_px4: bool) -> None:
    """Reject outputs that the autopilot does not have.

    Raises:
        InputError: there is one.
    """
    if of_px4 and max(abs(number) for number in channels) > PX4_OUTPUTS:
        raise InputError(f"channels {channels}: PX4 has {PX4_OUTPUTS} outputs")


def check_push(push: Push) -> None:
    """Reject a launch too weak for the launch detection.

    Raises:
        InputError: it is.
    """
    if not push.is_detectable:
        raise InputError(
            f"launch throw: {push.acceleration:.3g} m/s^2 is too weak for a launch detection; use --launch throttle"
        )


def ardupilot_parameters(subject: Subject) -> list[Parameter]:
    """Return the parameters of ArduPlane, by the names of version 4.5 and later."""
    gains, performance = subject.vehicle.gains, subject.performance
    return [
        Parameter("SIM_RATE_HZ", 400, "Hz", "chosen: two steps per IMU sample"),
        *_ardupilot_outputs(subject.channels, subject.pulses),
        *ardupilot_limits(gains),
        Parameter("AIRSPEED_CRUISE", performance.cruise_airspeed, "m/s", "cruise.airspeed of the world's file"),
        Parameter("AIRSPEED_MAX", performance.max_airspeed, "m/s", AIRSPEED_SOURCE),
        Parameter("TRIM_THROTTLE", round(100.0 * performance.throttle), "%", "trim: level at the cruise"),
        Parameter("TECS_CLMB_MAX", performance.climb_rate, "m/s", CLIMB_SOURCE),
        *_ardupilot_launch(subject.push),
        Parameter("ARMING_REQUIRE", 2, "-", "chosen: no throttle pulse while disarmed, so arming is visible"),
        Parameter("THR_FAILSAFE", 0, "-", "chosen: no radio; 1 with --sticks"),
        Parameter("FS_SHORT_ACTN", 3, "-", "chosen: disabled, no radio"),
        Parameter("FS_LONG_ACTN", 0, "-", "chosen: continue, no radio"),
    ]


def ardupilot_limits(gains: FlightGains) -> list[Parameter]:
    """Return the limits of ArduPlane that the flight vehicle's gains determine."""
    return [
        Parameter("AIRSPEED_STALL", gains.excitation.airspeed_min, "m/s", "excitation.airspeed_min"),
        Parameter("AIRSPEED_MIN", gains.altitude.airspeed_min, "m/s", "altitude.airspeed_min"),
        Parameter("THR_MIN", _percent(gains.altitude.throttle_min), "%", "altitude.throttle_min"),
        Parameter("THR_MAX", _percent(gains.altitude.throttle_max), "%", "altitude.throttle_max"),
        Parameter("TECS_SINK_MAX", gains.altitude.sink_max, "m/s", "altitude.sink_max"),
        Parameter("TECS_SINK_MIN", min(2.0, gains.altitude.sink_max), "m/s", "default; at most TECS_SINK_MAX"),
        Parameter("ROLL_LIMIT_DEG", _degrees(gains.heading.roll_max), DEGREE, "heading.roll_max"),
        Parameter("PTCH_LIM_MAX_DEG", _degrees(gains.altitude.pitch_max), DEGREE, "altitude.pitch_max"),
        Parameter("PTCH_LIM_MIN_DEG", _degrees(gains.altitude.pitch_min), DEGREE, "altitude.pitch_min"),
    ]


def px4_limits(gains: FlightGains) -> list[Parameter]:
    """Return the limits of PX4 that the flight vehicle's gains determine."""
    return [
        Parameter("FW_AIRSPD_STALL", gains.excitation.airspeed_min, "m/s", "excitation.airspeed_min"),
        Parameter("FW_AIRSPD_MIN", gains.altitude.airspeed_min, "m/s", "altitude.airspeed_min"),
        Parameter("FW_THR_MIN", gains.altitude.throttle_min, "-", "altitude.throttle_min"),
        Parameter("FW_THR_MAX", gains.altitude.throttle_max, "-", "altitude.throttle_max"),
        Parameter("FW_T_SINK_MAX", gains.altitude.sink_max, "m/s", "altitude.sink_max"),
        Parameter("FW_T_SINK_MIN", min(2.0, gains.altitude.sink_max), "m/s", "default; at most FW_T_SINK_MAX"),
        Parameter("FW_R_LIM", _degrees(gains.heading.roll_max), DEGREE, "heading.roll_max"),
        Parameter("FW_P_LIM_MAX", _degrees(gains.altitude.pitch_max), DEGREE, "altitude.pitch_max"),
        Parameter("FW_P_LIM_MIN", _degrees(gains.altitude.pitch_min), DEGREE, "altitude.pitch_min"),
    ]


def px4_parameters(subject: Subject) -> list[Parameter]:
    """Return the parameters of PX4 for airframe 1030 with replaced surfaces, outputs and trims."""
    gains, performance = subject.vehicle.gains, subject.performance
    pitch = _degrees(performance.pitch)
    return [
        *_px4_outputs(subject.channels),
        *px4_limits(gains),
        Parameter("FW_AIRSPD_TRIM", performance.cruise_airspeed, "m/s", "cruise.airspeed of the world's file"),
        Parameter("FW_AIRSPD_MAX", performance.max_airspeed, "m/s", AIRSPEED_SOURCE),
        Parameter("FW_THR_TRIM", performance.throttle, "-", "trim: level at the cruise"),
        Parameter("FW_T_CLMB_MAX", performance.climb_rate, "m/s", CLIMB_SOURCE),
        Parameter("FW_PSP_OFF", pitch, DEGREE, "trim: level at the cruise"),
        Parameter("TRIM_PITCH", performance.elevator, "-", "trim: elevator output, level at the cruise"),
        *_px4_launch(subject.push),
    ]


def ardupilot_file(title: str, parameters: Iterable[Parameter]) -> str:
    """Format an ArduPilot parameter file: NAME VALUE and a comment."""
    lines = (f"{one.name:<16} {one.text:<8} # {one.unit}; {one.source}" for one in parameters)
    return _with_heading(title, lines)


def px4_file(title: str, parameters: Iterable[Parameter]) -> str:
    """Format a shell file that is sourced before PX4: its start script reads PX4_PARAM_NAME variables."""
    lines = (f"export PX4_PARAM_{one.name}={one.text}  # {one.unit}; {one.source}" for one in parameters)
    return _with_heading(title, lines)


def qgroundcontrol_file(title: str, parameters: Iterable[Parameter]) -> str:
    """Format QGroundControl's parameter file: vehicle, component, name, value and MAV_PARAM_TYPE, by tabs."""
    lines = []
    for one in parameters:
        kind = PARAM_INT32 if isinstance(one.value, int) else PARAM_REAL32
        lines += [f"# {one.name}: {one.unit}; {one.source}", f"1\t1\t{one.name}\t{one.text}\t{kind}"]
    return _with_heading(title, ["# Vehicle-Id Component-Id Name Value Type", *lines])


def _with_heading(title: str, lines: Iterable[str]) -> str:
    heading = textwrap.wrap(
        title, LINE_LENGTH - 2, initial_indent="# ", subsequent_indent="# ", break_on_hyphens=False
    )
    return "\n".join([*heading, *lines, ""])


def _ardupilot_outputs(channels: Channels, pulses: Pulses) -> list[Parameter]:
    middle = round(0.5 * (pulses.low + pulses.high))
    used = {abs(number) for number in channels if number}
    result = []
    if max(used) > ARDUPILOT_OUTPUTS:
        result.append(Parameter("SERVO_32_ENABLE", 1, "-", "--channels above 16"))
    for name, number, function in zip(Channels._fields, channels, ARDUPILOT_FUNCTIONS, strict=True):
        if not number:
            continue
        servo, rest = f"SERVO{abs(number)}", round(pulses.low) if name == "throttle" else middle
        result += [
            Parameter(f"{servo}_FUNCTION", function, "-", f"--channels: {name}"),
            Parameter(f"{servo}_MIN", round(pulses.low), "us", "--pwm"),
            Parameter(f"{servo}_MAX", round(pulses.high), "us", "--pwm"),
            Parameter(f"{servo}_TRIM", rest, "us", "--pwm: " + ("closed" if name == "throttle" else "middle")),
            Parameter(f"{servo}_REVERSED", int(number < 0), "-", "--channels: sign"),
        ]
    unused = (number for number in range(1, len(channels) + 1) if number not in used)
    return result + [Parameter(f"SERVO{number}_FUNCTION", 0, "-", "--channels: not used") for number in unused]


def _px4_outputs(channels: Channels) -> list[Parameter]:
    used = {abs(number): name for name, number in zip(Channels._fields, channels, strict=True) if number}
    result = []
    for number in sorted({*used, *PX4_AIRFRAME_OUTPUTS}):
        name = used.get(number, "")
        function = getattr(PX4_FUNCTIONS, name) if name else 0
        source = f"--channels: {name}" if name else "--channels: not used"
        result.append(Parameter(f"PWM_MAIN_FUNC{number}", function, "-", source))
    reverse = sum(1 << (-number - 1) for number in channels if number < 0)
    result.append(Parameter("PWM_MAIN_REV", reverse, "-", "--channels: bit n-1 of each reversed output n"))
    result.append(Parameter("CA_SV_CS_COUNT", len(PX4_SURFACES), "-", "aileron, elevator, rudder"))
    for number, (kind, torque) in enumerate(PX4_SURFACES):
        surface = f"CA_SV_CS{number}"
        result.append(Parameter(f"{surface}_TYPE", kind, "-", ("aileron", "elevator", "rudder")[number]))
        result += [
            Parameter(f"{surface}_TRQ_{axis}", float(value), "-", "chosen: one axis per surface")
            for axis, value in zip("RPY", torque, strict=True)
        ]
    return result


def _ardupilot_launch(push: Push | None) -> list[Parameter]:
    speed = Parameter("TKOFF_THR_MINSPD", 0, "m/s", "chosen: no check of the speed over the ground")
    if push is None:
        return [Parameter("TKOFF_THR_MINACC", 0, "m/s^2", "--launch throttle: no detection"), speed]
    delay = max(round(10.0 * push.duration) - 1, 0)
    return [
        Parameter("TKOFF_THR_MINACC", _threshold(push), "m/s^2", f"throw: {push.acceleration:.3g} m/s^2"),
        speed,
        Parameter("TKOFF_THR_DELAY", delay, "0.1 s", f"throw: {push.duration:g} s, the detection takes 0.1 s of it"),
    ]


def _px4_launch(push: Push | None) -> list[Parameter]:
    runway = Parameter("RWTO_TKOFF", 0, "-", "chosen: launched by hand")
    if push is None:
        return [runway, Parameter("FW_LAUN_DETCN_ON", 0, "-", "--launch throttle: no detection")]
    return [
        runway,
        Parameter("FW_LAUN_DETCN_ON", 1, "-", "--launch throw"),
        Parameter("FW_LAUN_AC_THLD", _threshold(push), "m/s^2", f"throw: {push.acceleration:.3g} m/s^2"),
        Parameter("FW_LAUN_AC_T", min(DETECTION_TIME, push.duration / 3.0), "s", f"throw: {push.duration:g} s"),
        Parameter("FW_LAUN_MOT_DEL", 0.0, "s", "chosen: wings do not endanger the hand"),
    ]


def _threshold(push: Push) -> float:
    return float(f"{push.threshold:.3g}")


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 1)


def _percent(share: float) -> int:
    return round(100.0 * share)
