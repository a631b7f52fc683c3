"""Effect of the three stick inputs on the state.

The priorities are: frames of the receiver, channels of an override, MANUAL_CONTROL. After a timeout of a source the
next one is used, and without any the sticks are neutral. A kill switch is effective in every source. All stick inputs
are published with their source; a change of the active source is reported.
"""

from __future__ import annotations

import math

from avionics import topics
from avionics.limits import clip
from avionics.messages import ChannelOverride, CommandKind, PilotInput, PilotSource, ReceiverSample
from avionics.sensing import pilot, receiver
from avionics.sensing.pilot import Act
from avionics.state import AutopilotState
from wingbeat.message import Event, Severity
from wingbeat.topic import Publish

NOTHING: tuple[Act, ...] = ()
IN_COMMAND = {
    PilotSource.MANUAL_CONTROL: "MANUAL_CONTROL",
    PilotSource.OVERRIDE: "RC_CHANNELS_OVERRIDE",
    PilotSource.RECEIVER: "receiver",
}


def take_sticks(s: AutopilotState, publish: Publish, sticks: PilotInput) -> tuple[Act, ...]:
    """Process MANUAL_CONTROL; sticks that are not finite are rejected and counted."""
    _, pitch, roll, yaw, throttle, _ = sticks
    if not math.isfinite(pitch + roll + yaw + throttle):
        s.plausibility = s.plausibility._replace(rejected=s.plausibility.rejected + 1)
        return NOTHING
    pitch, roll, yaw = (clip(axis, -1.0, 1.0) for axis in (pitch, roll, yaw))
    held = receiver.Sticks(pitch, roll, yaw, clip(throttle, 0.0, 1.0))
    time_us = sticks.time_us
    publish(topics.PILOT, PilotInput(time_us, *held, PilotSource.MANUAL_CONTROL))
    s.stick_inputs = s.stick_inputs._replace(manual=held, manual_us=time_us)
    watch(s, publish)
    _fly(s)
    return NOTHING


def take_override(s: AutopilotState, publish: Publish, override: ChannelOverride) -> tuple[Act, ...]:
    """Process RC_CHANNELS_OVERRIDE."""
    publish(topics.OVERRIDE, override)
    before = s.stick_inputs
    s.stick_inputs = pilot.take_override(s.gains.receiver, before, override)
    if s.stick_inputs.override.time_us >= 0:
        publish(topics.PILOT, PilotInput(override.time_us, *s.stick_inputs.override.sticks, PilotSource.OVERRIDE))
    watch(s, publish)
    _fly(s)
    return _acts(s, before.override, s.stick_inputs.override, PilotSource.OVERRIDE)


def take_receiver(s: AutopilotState, publish: Publish, sample: ReceiverSample) -> tuple[Act, ...]:
    """Process a frame of the receiver."""
    before = s.stick_inputs
    s.stick_inputs = pilot.take_receiver(s.gains.receiver, before, sample)
    if s.stick_inputs is before:
        return NOTHING
    publish(topics.PILOT, PilotInput(sample.time_us, *s.stick_inputs.radio.sticks, PilotSource.RECEIVER))
    watch(s, publish)
    _fly(s)
    return _acts(s, before.radio, s.stick_inputs.radio, PilotSource.RECEIVER)


def _acts(s: AutopilotState, before: receiver.State, after: receiver.State, source: PilotSource) -> tuple[Act, ...]:
    """Return a kill of any source, or mode and arming commands of the active source."""
    if pilot.kill_switch(s.stick_inputs):
        return (Act(CommandKind.KILL),) if s.modes.armed else NOTHING
    if s.stick_inputs.source != source or before is after:
        return NOTHING
    return pilot.acts(s.gains.receiver, before, after, disarmed=not s.modes.armed)


def watch(s: AutopilotState, publish: Publish) -> None:
    """Select the active stick input; report a change."""
    ways = s.stick_inputs
    source = pilot.choose(s.gains.receiver, ways, s.clock.time_us)
    if source != ways.source:
        s.stick_inputs = ways._replace(source=int(source))
        _announce(s, publish, source)
        _fly(s)


def _fly(s: AutopilotState) -> None:
    source = PilotSource(s.stick_inputs.source)
    s.pilot = PilotInput(max(s.clock.time_us, 0), *pilot.sticks(s.stick_inputs), source)


def _announce(s: AutopilotState, publish: Publish, source: PilotSource) -> None:
    lost = source == PilotSource.NONE
    severity = Severity.WARNING if lost else Severity.INFO
    text = "manual control lost: sticks neutral" if lost else f"manual control by {IN_COMMAND[source]}"
    publish(topics.EVENTS, Event(s.clock.time_us, severity, "pilot", text))
