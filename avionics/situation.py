"""The state as the modes and the navigation look at it."""

from __future__ import annotations

import math

from avionics.guidance import heading, modes, navigation
from avionics.messages import PilotSource
from avionics.sensing import pilot, plausibility
from avionics.state import STANDARD_GRAVITY, AutopilotState


def position_usable(s: AutopilotState) -> int:
    """1 while there is a position that is not older than the allowed loss of fixes."""
    age = plausibility.gps_age(s.plausibility, s.clock.time_us)
    return int(s.position.valid == 1 and age <= s.gains.modes.gps_loss_delay)


def ground_motion(s: AutopilotState) -> heading.Measured:
    """What the heading loop looks at."""
    return heading.Measured(
        s.attitude.yaw, s.position.v_north, s.position.v_east, position_usable(s), bank_of_path(s)
    )


def bank_of_path(s: AutopilotState) -> float:
    """Bank (rad) of a steady turn along the path's curve at the present ground speed: tan bank = V^2 / (g R)."""
    if s.target.curvature == 0.0:
        return 0.0
    square = s.position.v_north**2 + s.position.v_east**2
    return math.atan(square * s.target.curvature / STANDARD_GRAVITY)


def conditions(s: AutopilotState) -> modes.Conditions:
    """What the modes look at."""
    imu_age = plausibility.imu_age(s.plausibility, s.clock.time_us)
    return modes.Conditions(
        forward_force=s.frame.imu.accel_x,
        airspeed=s.air.airspeed,
        altitude=s.altitude.altitude,
        climb_rate=s.altitude.climb_rate,
        roll=s.attitude.roll,
        pitch=s.attitude.pitch,
        ground_speed=math.hypot(s.position.v_north, s.position.v_east),
        home_distance=math.hypot(s.position.north, s.position.east),
        fix_age=plausibility.gps_age(s.plausibility, s.clock.time_us),
        battery=s.power_state.battery_remaining,
        settled=int(s.attitude.window > 0.0),
        imu_fault=int(imu_age > s.gains.plausibility.fault_time),
        items=len(s.mission),
        throttle_stick=s.pilot.throttle,
        wanted_stage=s.target.stage,
        fence_clearance=s.fence_clearance if position_usable(s) else math.inf,
        fence_floor=s.fence.floor,
        fence_ceiling=s.fence.ceiling,
        pilot_lost=int(s.ways_in.source == PilotSource.NONE),
        kill_switch=int(pilot.kill_switch(s.ways_in)),
    )


def surroundings(s: AutopilotState) -> navigation.Situation:
    """What the navigation looks at."""
    usable = position_usable(s)
    return navigation.Situation(
        mode=s.modes.mode,
        stage=s.modes.stage,
        north=s.position.north,
        east=s.position.east,
        valid=usable,
        heading=heading.course(s.gains.heading, ground_motion(s)),
        altitude=s.altitude.altitude,
        stick_pitch=s.pilot.pitch,
        excitations=s.excitation.finished,
        airspeed=s.air.airspeed,
        ground_speed=math.hypot(s.position.v_north, s.position.v_east) if usable else 0.0,
        wind_north=s.position.wind_north if usable else 0.0,
        wind_east=s.position.wind_east if usable else 0.0,
        rally=s.rally,
    )
