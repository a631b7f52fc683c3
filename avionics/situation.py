"""The state as the modes and the navigation look at it."""

from __future__ import annotations

import math

from avionics.guidance import heading, modes, navigation
from avionics.sensing import plausibility
from avionics.state import AutopilotState


def position_usable(s: AutopilotState) -> int:
    """1 while there is a position that is not older than the allowed loss of fixes."""
    age = plausibility.gps_age(s.plausibility, s.clock.time_us)
    return int(s.position.valid == 1 and age <= s.gains.modes.gps_loss_delay)


def ground_motion(s: AutopilotState) -> heading.Measured:
    """What the heading loop looks at."""
    return heading.Measured(s.attitude.yaw, s.position.v_north, s.position.v_east, position_usable(s))


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
    )


def surroundings(s: AutopilotState) -> navigation.Situation:
    """What the navigation looks at."""
    return navigation.Situation(
        mode=s.modes.mode,
        stage=s.modes.stage,
        north=s.position.north,
        east=s.position.east,
        valid=position_usable(s),
        heading=heading.course(s.gains.heading, ground_motion(s)),
        altitude=s.altitude.altitude,
        stick_pitch=s.pilot.pitch,
        excitations=s.excitation.finished,
    )
