"""I-PD law of the pitch loop: the integral acts on the error, the other terms on the measurement alone.

A PID controller of two degrees of freedom with setpoint weight zero (Astrom and Hagglund 2006, Advanced PID Control,
section 3.4). A step of the setpoint does not step the elevator, and the response has no zero at -I/P, which makes a
PID loop overshoot. Stability margins are those of the PID law with the same gains; the response to the setpoint is
slower. A PID law behind the setpoint filter 1 / (1 + s P/I) is the same transfer function, and is what is computed.
"""

from __future__ import annotations

from avionics.limits import low_pass
from avionics.messages import PitchStatus
from avionics.stabilization import pitch
from avionics.stabilization.pitch import Gains, Measured, State


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """One step; ``dt`` in s, ``setpoint`` in rad. The error in the status is that to the filtered setpoint."""
    state = _filter_setpoint(gains, state, dt, setpoint)
    state, status = pitch.step(gains, state, time_us, dt, state.setpoint, measured)
    return state, status._replace(pitch_setpoint=setpoint)


def hold_trim(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """Return the mean elevator while an excitation is active, see `pitch.hold_trim`; the filter keeps running."""
    state = _filter_setpoint(gains, state, dt, setpoint)
    state, status = pitch.hold_trim(gains, state, time_us, dt, state.setpoint, measured)
    return state, status._replace(pitch_setpoint=setpoint)


def follow(
    gains: Gains, state: State, time_us: int, dt: float, elevator: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """The pilot's elevator (rad); the filtered setpoint tracks the pitch, for a start without an error."""
    state, status = pitch.follow(gains, state, time_us, dt, elevator, measured)
    return state._replace(setpoint=state.pitch), status


def _filter_setpoint(gains: Gains, state: State, dt: float, setpoint: float) -> State:
    """Without an integral nothing would follow the setpoint, so it passes unfiltered."""
    if gains.integral == 0.0:
        return state._replace(setpoint=setpoint)
    return state._replace(setpoint=low_pass(state.setpoint, setpoint, gains.proportional / gains.integral, dt))
