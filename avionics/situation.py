"""Inputs of modes and navigation from the state."""

from __future__ import annotations

import math
from typing import Final

from avionics.estimation import ahrs
from avionics.guidance import heading, modes, navigation, offboard
from avionics.guidance.mission import ItemKind
from avionics.guidance.route import FASTEST_DRIFT, least_altitude
from avionics.limits import clip
from avionics.messages import Failsafe, Mode, PilotSource
from avionics.sensing import pilot, plausibility, preflight
from avionics.state import AutopilotState
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.records import constructor

NO_PILOT, RECEIVER = PilotSource.NONE, PilotSource.RECEIVER
PLACED = (ItemKind.WAYPOINT, ItemKind.LOITER, ItemKind.CIRCLE, ItemKind.LAND)
"""items with a position"""
TRAVEL_MARGIN: Final = 0.2
"""rad; tolerance of the wing travel, for play in the linkage"""
FORCE_MARGIN: Final = 3.0
"""m/s^2; maximum deviation of the specific force from 1 g at arming"""


def position_usable(s: AutopilotState) -> int:
    """Return 1 if the position is valid and within the fix timeout."""
    age = plausibility.gps_age(s.plausibility, s.clock.time_us)
    return int(s.position.valid == 1 and age <= s.gains.modes.gps_loss_delay)


def ground_motion(s: AutopilotState) -> heading.Measured:
    """Return the measurements of the heading loop."""
    north, east, usable = s.position.v_north, s.position.v_east, position_usable(s)
    drifting = drift(s) if usable else 1.0
    return heading.Measured(s.attitude.yaw, north, east, usable, bank_of_path(s), drifting)


def drift(s: AutopilotState) -> float:
    """Return the ratio of ground speed to airspeed, from 1 to `FASTEST_DRIFT`."""
    over_ground = math.hypot(s.position.v_north, s.position.v_east)
    return clip(over_ground / s.air.airspeed, 1.0, FASTEST_DRIFT) if s.air.airspeed > 1.0 else 1.0


def bank_of_path(s: AutopilotState) -> float:
    """Return the bank (rad) of a steady turn with the curvature of the path.

    At the ground speed V: tan bank = V^2 / (g R).
    """
    if s.target.curvature == 0.0:
        return 0.0
    square = s.position.v_north**2 + s.position.v_east**2
    return math.atan(square * s.target.curvature / STANDARD_GRAVITY)


def destination(s: AutopilotState) -> tuple[float, float] | None:
    """Return the position (m, north and east) or circle center of the present target.

    The result is None on the ground and without a target.
    """
    navigated = s.navigation
    if s.modes.stage not in modes.AIRBORNE or navigated.mode != s.modes.mode or s.modes.mode not in modes.GUIDED:
        return None
    if s.modes.mode == Mode.RETURN and not navigated.landing_sequence:
        return navigated.goal_north, navigated.goal_east
    if s.modes.mode in (Mode.AUTO, Mode.RETURN) and navigated.item < len(s.mission):
        item = s.mission[navigated.item]
        if item.here:
            return navigated.from_north, navigated.from_east
        return (item.north, item.east) if item.kind in PLACED else None
    return (navigated.centre_north, navigated.centre_east) if navigated.radius else None


_new_conditions: Final = constructor(modes.Conditions)


def conditions(s: AutopilotState) -> modes.Conditions:
    """Return the inputs of the modes."""
    imu_age = plausibility.imu_age(s.plausibility, s.clock.time_us)
    return _new_conditions(
        forward_force=s.frame.imu.accel_x,
        airspeed=touching_airspeed(s),
        altitude=s.altitude.altitude,
        climb_rate=s.altitude.climb_rate,
        roll=s.attitude.roll,
        pitch=s.attitude.pitch,
        ground_speed=math.hypot(s.position.v_north, s.position.v_east),
        home_distance=math.hypot(s.position.north, s.position.east),
        fix_age=plausibility.gps_age(s.plausibility, s.clock.time_us),
        battery=min(s.power_state.battery_remaining, s.power.battery.by_voltage),
        settled=int(s.attitude.window > 0.0),
        imu_fault=int(imu_age > s.gains.plausibility.fault_time),
        items=len(s.mission),
        throttle_stick=s.pilot.throttle,
        requested_stage=s.target.stage,
        above_flare=int(s.height > s.gains.navigation.flare_altitude),
        fence_clearance=s.fence_clearance if s.fence.zones and position_usable(s) else math.inf,
        fence_floor=s.fence.floor,
        fence_ceiling=s.fence.ceiling,
        pilot_lost=int(s.stick_inputs.source == NO_PILOT),
        kill_switch=int(pilot.kill_switch(s.stick_inputs)),
        sensed=sensed(s),
        turn_rate=max(abs(s.attitude.roll_rate), abs(s.attitude.pitch_rate), abs(s.attitude.yaw_rate)),
        return_floor=least_altitude(s.gains.navigation, ceiling(s)),
        by_receiver=int(s.stick_inputs.source == RECEIVER),
        final=s.navigation.final,
        navigated=s.navigation.mode,
        setpoint_valid=offboard.valid(s.gains.navigation, s.offboard, s.clock.time_us),
    )


def touching_airspeed(s: AutopilotState) -> float:
    """Return the airspeed (m/s) for touchdown detection.

    The result is 0 on a landing with neither pitot nor fix, because the assumed cruise airspeed would prevent a
    touchdown.
    """
    unknown = s.airspeed_check.blocked and not position_usable(s) and s.modes.stage in modes.LANDING
    return 0.0 if unknown else s.air.airspeed


def ceiling(s: AutopilotState) -> float:
    """Return the maximum altitude setpoint (m).

    It is the lower ceiling of the fences minus the margin, or half of a low ceiling.
    """
    fence = min(s.gains.modes.fence_altitude, s.fence.ceiling or math.inf)
    return max(fence - s.gains.modes.fence_margin, 0.5 * fence)


def sensed(s: AutopilotState) -> int:
    """Return the flags of the failures detected by the sensing modules."""
    wings = s.wing_check
    flags = 0
    if wings.jammed or wings.lost:
        flags |= (Failsafe.WING_JAMMED if wings.jammed else 0) | (Failsafe.ENCODER_LEFT if wings.lost & 1 else 0)
        flags |= Failsafe.ENCODER_RIGHT if wings.lost & 2 else 0
    if s.airspeed_check.blocked:
        flags |= Failsafe.PITOT_BLOCKED
    if s.plausibility.saturated >= plausibility.SATURATED:
        flags |= Failsafe.ACCEL_SATURATED
    if s.altitude_filter.refused > 0.0:
        flags |= Failsafe.BARO_REFUSED
    if plausibility.baro_lost(s.gains.plausibility, s.plausibility, s.clock.time_us):
        flags |= Failsafe.BARO_LOST
    if s.tail_check.jammed:
        flags |= Failsafe.TAIL_JAMMED
    if s.attitude.magnetometer_disturbed:
        flags |= Failsafe.MAG_DISTURBED
    if pilot.receiver_lost(s.gains.receiver, s.stick_inputs, s.clock.time_us):
        flags |= Failsafe.RECEIVER_LOST
    return flags


def unready(s: AutopilotState) -> tuple[str, ...]:
    """Return further reasons against arming: sensors and their calibration."""
    left, right = s.wing.angle_left, s.wing.angle_right
    flap = s.gains.flapping
    force = math.hypot(*s.frame.imu.accel)
    checks = (
        (s.wing.time_us == 0, "no encoder samples"),
        (s.air.time_us == 0, "no pressure samples"),
        (s.power_state.time_us == 0, "no power samples"),
        (max(left, right) > flap.travel_max + TRAVEL_MARGIN, "wing angle above its travel: calibrate WINGS"),
        (min(left, right) < flap.travel_min - TRAVEL_MARGIN, "wing angle below its travel: calibrate WINGS"),
        (
            abs(force - STANDARD_GRAVITY) > FORCE_MARGIN,
            "accelerometer: not 1 g; hold still, or calibrate it",
        ),
        (ahrs_limited(s), "gyro bias at its limit"),
    )
    reference = preflight.Reference(s.gains.ahrs.field_strength, s.gains.ahrs.field_dip)
    found = preflight.findings(s.gains.preflight, s.preflight, reference)
    return tuple(text for failed, text in checks if failed) + tuple(finding_text(s, finding) for finding in found)


def ahrs_limited(s: AutopilotState) -> bool:
    """Return whether the gyro bias has reached its limit relative to the standstill."""
    bias = (s.attitude.bias_x, s.attitude.bias_y, s.attitude.bias_z)
    return s.ahrs is not None and not ahrs.aligned(s.gains.ahrs, s.ahrs, bias)


def finding_text(s: AutopilotState, finding: preflight.Finding) -> str:
    """Return the text of a sensor error with measured value and remedy."""
    gains, rest = s.gains.preflight, s.preflight.rest
    if finding == preflight.Finding.GYRO_OFFSET:
        return f"gyro: rate at rest exceeds {math.degrees(gains.gyro_offset):.0f} deg/s; hold still, or replace it"
    if finding == preflight.Finding.GYRO_UNCALIBRATED or rest is None:
        return f"gyro: not calibrated; hold still for {gains.window * gains.windows:g} s"
    means, reference = rest.means, s.gains.ahrs
    if finding == preflight.Finding.ACCELEROMETER:
        return f"accelerometer: {math.hypot(*means.force) / STANDARD_GRAVITY:.2f} g at rest; calibrate it"
    if finding == preflight.Finding.FIELD_STRENGTH:
        measured, expected = math.hypot(*means.field), reference.field_strength
        return f"magnetometer: field of {measured:.2f} gauss, expected {expected:.2f}; remove iron, or calibrate it"
    if finding == preflight.Finding.FIELD_DIP:
        measured, expected = math.degrees(preflight.dip(means)), math.degrees(reference.field_dip)
        text = f"field dips {measured:.0f} deg, expected {expected:.0f}; remove iron, or calibrate both"
        return f"magnetometer or accelerometer: {text}"
    return f"pitot: {means.pressure:.0f} Pa at rest; cover it and calibrate its zero"


def surroundings(s: AutopilotState) -> navigation.Situation:
    """Return the inputs of the navigation."""
    usable = position_usable(s)
    seen = heading.Measured(s.attitude.yaw, s.position.v_north, s.position.v_east, usable)
    return navigation.Situation(
        mode=s.modes.mode,
        stage=s.modes.stage,
        north=s.position.north,
        east=s.position.east,
        valid=usable,
        heading=heading.course(s.gains.heading, seen),
        altitude=s.altitude.altitude,
        stick_pitch=s.pilot.pitch,
        excitations=s.excitation.finished,
        airspeed=s.air.airspeed,
        ground_speed=math.hypot(s.position.v_north, s.position.v_east) if usable else 0.0,
        wind_north=s.position.wind_north if usable else 0.0,
        wind_east=s.position.wind_east if usable else 0.0,
        rally=s.rally,
        ceiling=ceiling(s),
        rescued=s.modes.rescued,
        setpoint=s.offboard.setpoint,
        terrain=s.terrain,
        mission_allowed=int(not s.mission_breach),
    )
