"""Flight stages from launch to landing: launch detection, navigation, touchdown."""

from __future__ import annotations

import math
from typing import Final

from avionics.guidance.modes import (
    AIRBORNE,
    ANY_MODE,
    GUIDED,
    LANDING,
    PILOTED,
    Conditions,
    Gains,
    Notice,
    Outcome,
    State,
)
from avionics.messages import Failsafe, Mode, Stage
from wingbeat.constants import STANDARD_GRAVITY
from wingbeat.message import Severity

PITOT_BLOCKED: Final = int(Failsafe.PITOT_BLOCKED)
WAIT_LAUNCH, EN_ROUTE = Stage.WAIT_LAUNCH, Stage.EN_ROUTE
"""Cached members: access to an enum member costs as much as a call."""
PUSH_MEMORY: Final = 1.0
"""s; decay time of the integrated speed and of the accelerometer bias in it; longer than a motion of the hand"""
SLOW: Final = 0.5
"""-; fraction of `Gains.launch_push` below which a push without force ends; an attitude error may cause such a push
"""
BLIND_REACH: Final = 1.2
"""-; multiple of `Gains.launch_reach` at which a launch is detected without an airspeed"""
FAST: Final = 2
"""-; value of `State.launch_state`: the launch speed was reached, regardless of a later decrease by drag"""
STATIONARY_TRAVEL: Final = 0.4
"""m; maximum altitude change during a standstill: twice the noise of the altitude"""
NEAR_GROUND: Final = 0.5
"""-; fraction of the return floor below which a standstill counts as ground contact; a blocked pitot can indicate a
standstill in flight"""


def step(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    """Detect the launch, follow the navigation and detect the touchdown; ``dt`` in s."""
    if state.stage == WAIT_LAUNCH:
        return _watch_launch(gains, state, dt, conditions)
    if state.stage in AIRBORNE:
        return _watch_touchdown(gains, state, dt, conditions)
    return state, ()


def _watch_launch(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    """Detect a launch: the speed of a throw persists beyond the reach of an arm."""
    state = _pushed(gains, state, dt, conditions)
    upright = max(abs(conditions.roll), abs(conditions.pitch)) <= gains.launch_tilt
    far = state.push_way >= gains.launch_reach
    flown = conditions.airspeed >= gains.launch_airspeed or state.push_way >= BLIND_REACH * gains.launch_reach
    if not (state.launch_state == FAST and upright and far and flown):
        return state, ()
    stage = Stage.CLIMB_OUT if state.mode == Mode.AUTO else Stage.EN_ROUTE
    return without_push(state)._replace(stage=int(stage)), (Notice(Severity.NOTICE, "launched"),)


def _pushed(gains: Gains, state: State, dt: float, conditions: Conditions) -> State:
    """Integrate the forward force without gravity to speed and distance.

    The distance counts from the possible start of a throw.
    """
    accel = conditions.forward_force - STANDARD_GRAVITY * math.sin(conditions.pitch)
    push = (state.push + accel * dt) * (1.0 - dt / PUSH_MEMORY)
    force_time = state.force_time + dt if conditions.forward_force > gains.launch_force else 0.0
    if force_time == 0.0 and push < SLOW * gains.launch_push:
        return state._replace(push=push, push_way=0.0, force_time=0.0, launch_state=0)
    launch_state = max(state.launch_state, int(force_time >= gains.launch_time))
    if launch_state and push >= gains.launch_push:
        launch_state = FAST
    way = max(state.push_way + push * dt, 0.0) if force_time > 0.0 or state.push_way > 0.0 else 0.0
    return state._replace(push=push, push_way=way, force_time=force_time, launch_state=launch_state)


def without_push(state: State) -> State:
    """Return ``state`` with the launch detection reset."""
    return state._replace(push=0.0, push_way=0.0, force_time=0.0, launch_state=0)


def _watch_touchdown(gains: Gains, state: State, dt: float, conditions: Conditions) -> Outcome:
    landing = state.stage in LANDING
    slow = conditions.airspeed < gains.touchdown_airspeed
    placed = conditions.fix_age <= gains.gps_loss_delay
    if (landing or conditions.sensed & PITOT_BLOCKED) and placed:
        slow = slow or conditions.ground_speed < gains.touchdown_airspeed
    near_ground = conditions.altitude <= NEAR_GROUND * conditions.return_floor or (
        placed and conditions.ground_speed < gains.touchdown_airspeed
    )
    slow = slow and (landing or near_ground)
    # In a headwind a floating vehicle is also slow over ground.
    still = slow and abs(conditions.climb_rate) < gains.touchdown_climb and not (landing and conditions.above_flare)
    # A floating vehicle still sinks slowly.
    still = still and (
        state.stationary_time == 0.0 or abs(conditions.altitude - state.stationary_altitude) < STATIONARY_TRAVEL
    )
    since = conditions.altitude if state.stationary_time == 0.0 else state.stationary_altitude
    lasted = state.stationary_time + dt if still else 0.0
    if lasted != state.stationary_time:
        state = state._replace(stationary_time=lasted, stationary_altitude=since)
    if lasted < (gains.touchdown_time if landing else gains.crash_time):
        return _follow_navigation(state, conditions)
    landed = state._replace(stage=int(Stage.LANDED), armed=0, stationary_time=0.0)
    return landed, (_on_the_ground(landing, state.mode),)


def _on_the_ground(landing: bool, mode: int) -> Notice:
    if landing:
        return Notice(Severity.NOTICE, "touchdown, disarmed")
    if mode in PILOTED:
        return Notice(Severity.NOTICE, "on the ground, disarmed")
    return Notice(Severity.CRITICAL, "on the ground outside an approach, disarmed")


def _follow_navigation(state: State, conditions: Conditions) -> Outcome:
    """Adopt the stage of the navigation in a guided mode, else EN_ROUTE."""
    if state.mode in GUIDED and conditions.navigated not in (ANY_MODE, state.mode):
        return state, ()
    wanted = conditions.requested_stage if state.mode in GUIDED else EN_ROUTE
    if wanted == state.stage or wanted not in AIRBORNE:
        return state, ()
    name = Stage(wanted).name.lower().replace("_", " ")
    return state._replace(stage=int(wanted)), (Notice(Severity.INFO, f"stage {name}"),)
