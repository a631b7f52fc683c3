"""Gymnasium environment of a flapping-wing aircraft: hold altitude and heading in manual flight.

``gymnasium.make("wingbeat.gym:wingbeat/Flapping-v0", vehicle="arizona_100cm", turbulence="light")``.
``gymnasium.make_vec("wingbeat.gym:wingbeat/Flapping-v0", num_envs=64)`` flies 64 vehicles in compiled code on all
cores, see `FlappingVectorEnv`.

Each episode begins in the air: the flight computer launches the vehicle and flies for ``handover`` seconds, then the
agent flies it in MANUAL mode by the four stick inputs.

Observation (15 numbers, float32), from the true state:

==== ==================== ====== =====================================================
 0   altitude error       m      target minus altitude, positive: the vehicle is too low
 1   climb rate           m/s    positive up
 2   airspeed             m/s
 3   roll                 rad    right wing down is positive
 4   pitch                rad    nose up is positive
 5   heading error        rad    target minus heading, -pi to pi
6-8  p, q, r              rad/s  body rates
 9   sine of wing phase   -      phase of the commanded stroke; of the crank, if a motor turns one
10   cosine of wing phase -
11-14 previous action     -
==== ==================== ====== =====================================================

Action (4 numbers): pitch stick (-1 nose down to 1 nose up), roll stick, yaw stick (-1 left to 1 right), throttle
(-1 glide to 1 full flapping).

Reward per step: ``1 - (altitude error / 5 m)^2 - (heading error / 0.5 rad)^2``, at least -1; -10 on ground contact,
which ends the episode. The episode is truncated after ``time_limit`` seconds.
"""

import gymnasium

from wingbeat.gym.environment import FlappingEnv

__all__ = ["FlappingEnv"]

gymnasium.register(
    "wingbeat/Flapping-v0",
    entry_point="wingbeat.gym:FlappingEnv",
    vector_entry_point="wingbeat.gym.vector:FlappingVectorEnv",
)
