"""Table of topics for the recorder, the reader, telemetry and ``log info``."""

from __future__ import annotations

from typing import Any

from avionics import messages as m
from wingbeat.message import Event, RecorderStatus, Text
from wingbeat.samples import RangeSample
from wingbeat.topic import Topic

IMU = Topic("/sensors/imu", m.ImuSample, 1, 200.0)
ENCODER = Topic("/sensors/encoder", m.EncoderSample, 2, 200.0)
PRESSURES = Topic("/sensors/pressures", m.PressureSample, 3, 50.0)
ADC = Topic("/sensors/adc", m.AdcBurst, 4, 100.0)
TORQUE_RAW = Topic("/sensors/torque", m.TorqueSample, 5, 100.0)
GPS = Topic("/sensors/gps", m.GpsFix, 6, 5.0, 2.0)
PILOT = Topic("/inputs/pilot", m.PilotInput, 7, 0.0)
RECEIVER = Topic("/sensors/receiver", m.ReceiverSample, 8, 50.0)
OVERRIDE = Topic("/inputs/override", m.ChannelOverride, 9, 0.0)
VIBRATION = Topic("/sensors/vibration", m.VibrationStatus, 10, 1.0)
RANGE = Topic("/sensors/range", RangeSample, 11, 50.0, 5.0)

ATTITUDE = Topic("/attitude/ahrs", m.Attitude, 20, 200.0, 10.0)
POWER = Topic("/power/state", m.PowerState, 21, 100.0, 2.0)
WING = Topic("/main/wing", m.WingState, 22, 200.0, 10.0)
DRIVE_TORQUE = Topic("/main/drive_torque", m.DriveTorque, 23, 100.0)
AIR_DATA = Topic("/main/air_data", m.AirData, 24, 50.0, 5.0)
ALTITUDE = Topic("/main/altitude", m.Altitude, 25, 50.0, 5.0)
POSITION = Topic("/main/position", m.Position, 26, 50.0, 5.0)

NAVIGATION = Topic("/guidance/navigation", m.NavigationStatus, 40, 20.0, 2.0)
ALTITUDE_LOOP = Topic("/guidance/altitude", m.AltitudeStatus, 41, 50.0)
HEADING_LOOP = Topic("/guidance/heading", m.HeadingStatus, 42, 50.0)
EXCITATION = Topic("/guidance/excitation", m.ExcitationStatus, 43, 100.0)
PITCH_LOOP = Topic("/stabilization/pitch", m.PitchStatus, 44, 100.0)
ROLL_LOOP = Topic("/stabilization/roll", m.RollStatus, 45, 100.0)
FLAP = Topic("/mixing/flap", m.FlapCommand, 46, 200.0)
ACTUATORS = Topic("/mixing/actuators", m.ActuatorCommand, 47, 200.0, 5.0)

HEALTH = Topic("/system/health", m.Health, 60, 1.0, 1.0)
TIMING = Topic("/system/timing", m.TaskTiming, 61, 5.0, deterministic=False)
EVENTS = Topic("/system/events", Event, 62, 0.0)
INPUTS = Topic("/system/inputs", Text, 63, 0.0)
"""all `m.Command` with the tick of their execution"""
CALIBRATION = Topic("/system/calibration", m.CalibrationStatus, 66, 0.0)
"""at every change, and twice a second during a calibration"""
SNAPSHOTS = Topic("/system/snapshots", Text, 64, 0.1)
"""complete state of the autopilot every ten seconds"""
CHANGES = Topic("/system/changes", Text, 69, 0.0)
"""JSON of parameter and mission changes in flight, see `avionics.inputs.publish_parameter`"""
FENCE = Topic("/system/fence", m.FenceState, 67, 1.0, 1.0)
LINK_EVENTS = Topic("/system/link_events", Event, 65, 0.0, deterministic=False)
"""events of the ground links, on the wall clock"""
RECORDER = Topic("/system/recorder", RecorderStatus, 68, 0.0, deterministic=False)
"""at each increase of the number of dropped records"""

TOPICS: tuple[Topic[Any], ...] = (
    IMU, ENCODER, PRESSURES, ADC, TORQUE_RAW, GPS, PILOT, RECEIVER, OVERRIDE, VIBRATION, RANGE,
    ATTITUDE, POWER, WING, DRIVE_TORQUE, AIR_DATA, ALTITUDE, POSITION,
    NAVIGATION, ALTITUDE_LOOP, HEADING_LOOP, EXCITATION, PITCH_LOOP, ROLL_LOOP, FLAP, ACTUATORS,
    HEALTH, TIMING, EVENTS, INPUTS, SNAPSHOTS, LINK_EVENTS, CALIBRATION, CHANGES, FENCE, RECORDER,
)  # fmt: skip
