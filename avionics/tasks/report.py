"""Reporting tasks: excitation, health and snapshot."""

from __future__ import annotations

from avionics import snapshot, topics
from avionics.messages import Failsafe, Health
from avionics.sensing import vibration
from avionics.state import AutopilotState
from wingbeat.message import Text
from wingbeat.topic import Publish


def report_excitation(s: AutopilotState, publish: Publish) -> None:
    """Publish the identification input as applied, after limits and servo rate."""
    applied = s.excitation_requested
    if applied.active:
        elevator, throttle, rudder = s.excitation_applied
        applied = applied._replace(elevator=elevator, throttle=throttle, rudder=rudder)
    publish(topics.EXCITATION, applied)


def report_health(s: AutopilotState, publish: Publish) -> None:
    """Publish failures, rejected samples, vibration and the fence state."""
    publish(topics.VIBRATION, vibration.status(s.vibration, s.clock.time_us))
    publish(topics.HEALTH, Health(s.clock.time_us, s.modes.failsafe, s.plausibility.rejected, s.clock.ticks + 1))
    outside = int(s.modes.failsafe & Failsafe.FENCE != 0)
    publish(topics.FENCE, s.fence_state._replace(time_us=s.clock.time_us, outside=outside))


def report_snapshot(s: AutopilotState, publish: Publish) -> None:
    """Publish the complete state, from which a replay can start."""
    publish(topics.SNAPSHOTS, Text(s.clock.time_us, snapshot.encode(s)))
