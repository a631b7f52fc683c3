"""I-PD law of the pitch loop, with setpoint weight zero.

A PID controller of two degrees of freedom with setpoint weight zero (Astrom and Hagglund 2006, Advanced PID Control,
section 3.4). A step of the setpoint does not step the elevator, and the response has no zero at -I/P, which makes a
PID loop overshoot. Stability margins are those of the PID law with the same gains; the response to the setpoint is
slower. The implementation is a PID law after the setpoint filter 1 / (1 + s P/I), which has the same transfer
function.
"""

from __future__ import annotations

from avionics.limits import low_pass
from avionics.messages import PitchStatus
from avionics.stabilization import pitch
from avionics.stabilization.pitch import Gains, Measured, State


def step(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """Advance the loop by ``dt`` (s) toward ``setpoint`` (rad).

    The error in the status refers to the filtered setpoint.
    """
    state = _filter_setpoint(gains, state, dt, setpoint)
    state, status = pitch.step(gains, state, time_us, dt, state.setpoint, measured)
    return state, status._replace(pitch_setpoint=setpoint)


def hold_trim(
    gains: Gains, state: State, time_us: int, dt: float, setpoint: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """Return the mean elevator while an excitation is active.

    The setpoint filter keeps running, see `pitch.hold_trim`.
    """
    state = _filter_setpoint(gains, state, dt, setpoint)
    state, status = pitch.hold_trim(gains, state, time_us, dt, state.setpoint, measured)
    return state, status._replace(pitch_setpoint=setpoint)


def follow(
    gains: Gains, state: State, time_us: int, dt: float, elevator: float, measured: Measured
) -> tuple[State, PitchStatus]:
    """Track the pilot's elevator (rad) for a bumpless transfer to the loop.

    The filtered setpoint tracks the pitch, so that the loop starts without an error.
    """
    state, status = pitch.follow(gains, state, time_us, dt, elevator, measured)
    return state._replace(setpoint=state.pitch), status


def _filter_setpoint(gains: Gains, state: State, dt: float, setpoint: float) -> State:
    """Filter the setpoint; without an integral it passes unfiltered."""
    if gains.integral == 0.0:
        return state._replace(setpoint=setpoint)
    return state._replace(setpoint=low_pass(state.setpoint, setpoint, gains.proportional / gains.integral, dt))
