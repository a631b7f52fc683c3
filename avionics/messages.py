"""Messages between modules of the flight computer.

Conventions of units and axes, and the types of fields, are those of `wingbeat.message`.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag
from typing import Annotated, Any, NamedTuple

from wingbeat.message import Number, Time, Wire
from wingbeat.samples import (
    BURST_LENGTH as BURST_LENGTH,
)
from wingbeat.samples import (
    CHANNELS as CHANNELS,
)
from wingbeat.samples import (
    AdcBurst as AdcBurst,
)
from wingbeat.samples import (
    EncoderSample as EncoderSample,
)
from wingbeat.samples import (
    GpsFix as GpsFix,
)
from wingbeat.samples import (
    ImuSample as ImuSample,
)
from wingbeat.samples import (
    PressureSample as PressureSample,
)
from wingbeat.samples import (
    ReceiverSample as ReceiverSample,
)
from wingbeat.samples import (
    SensorFrame as SensorFrame,
)
from wingbeat.samples import (
    TorqueSample as TorqueSample,
)

# --- inputs from the ground -------------------------------------------------------------------------------


class PilotSource(IntEnum):
    """Sources of the stick inputs; a larger value has priority."""

    NONE = 0
    MANUAL_CONTROL = 1
    OVERRIDE = 2
    RECEIVER = 3


class PilotInput(NamedTuple):
    """Stick inputs; those of MANUAL_CONTROL enter the flight, the others follow from logged channels."""

    time_us: Time
    """us; since boot, time of execution"""
    pitch: float
    """-; from -1 nose down to 1 nose up"""
    roll: float
    """-; from -1 left to 1 right"""
    yaw: float
    """-; from -1 left to 1 right"""
    throttle: float
    """-; from 0 to 1 flapping"""
    source: Annotated[PilotSource, Wire("fixed32")] = PilotSource.MANUAL_CONTROL
    """-; source of the stick inputs"""


OVERRIDDEN = 18
"""number of channels in RC_CHANNELS_OVERRIDE"""


class ChannelOverride(NamedTuple):
    """RC_CHANNELS_OVERRIDE: channels set by a ground station instead of a receiver."""

    time_us: Time
    """us; since boot, time of execution"""
    pulses: Annotated[tuple[int, ...], Wire("fixed32", OVERRIDDEN)]
    """us; pulse widths, 0 to release a channel, 65535 to keep it unchanged"""


class CommandKind(IntEnum):
    """Kinds of a `Command`."""

    ARM = 1
    DISARM = 2
    SET_MODE = 3
    SET_PARAMETER = 4
    SET_MISSION = 5
    SET_CURRENT_ITEM = 6
    EXCITE = 7
    LINK_LOST = 8
    LINK_REGAINED = 9
    KILL = 10
    SET_FENCE = 11
    SET_RALLY = 12
    LOITER_AT = 13
    SET_SETPOINT = 14
    CHANGE_ALTITUDE = 15
    CHANGE_SPEED = 16
    CALIBRATE = 20


class Command(NamedTuple):
    """External command, executed at the start of the tick it is logged with."""

    time_us: int
    """us; since boot, time of the tick that executes it"""
    kind: CommandKind
    """-; kind of the command"""
    name: str = ""
    """-; name of the parameter, of the mode or of the calibration (empty to cancel), or empty; LOITER for a
    CHANGE_ALTITUDE that enters this mode if the vehicle does not circle"""
    value: float = 0.0
    """-; value of the parameter, index of the item, argument of a calibration, altitude above home in m for
    CHANGE_ALTITUDE, or 0"""
    payload: Any = None
    """-; mission items for SET_MISSION, a fence for SET_FENCE, rally points for SET_RALLY, an excitation item for
    EXCITE, a LOITER item for LOITER_AT, a setpoint for SET_SETPOINT, or an initial setpoint of OFFBOARD for SET_MODE
    """
    source: str = ""
    """-; sender: "script", "pilot" or the name of a link"""


Input = Command | PilotInput | ChannelOverride
"""inputs of a flight other than sensor frames"""


# --- estimates --------------------------------------------------------------------------------------------


class Attitude(NamedTuple):
    """Attitude, body rates and gyro bias from the AHRS."""

    time_us: Time
    """us; since boot"""
    roll: float
    """rad; positive right wing down, -pi to pi"""
    pitch: float
    """rad; positive nose up"""
    yaw: float
    """rad; clockwise from magnetic-corrected north, -pi to pi"""
    roll_rate: float
    """rad/s; about FRD x, bias removed"""
    pitch_rate: float
    """rad/s; about FRD y, bias removed"""
    yaw_rate: float
    """rad/s; about FRD z, bias removed"""
    quaternion_w: float
    """-; of r_ned_from_frd"""
    quaternion_x: float
    """-; of r_ned_from_frd"""
    quaternion_y: float
    """-; of r_ned_from_frd"""
    quaternion_z: float
    """-; of r_ned_from_frd"""
    bias_x: float
    """rad/s; gyro bias"""
    bias_y: float
    """rad/s; gyro bias"""
    bias_z: float
    """rad/s; gyro bias"""
    accel_down: float
    """m/s^2; acceleration along NED z (gravity removed), unfiltered"""
    tilt_error: float
    """rad; magnitude of the last gravity correction before its gain"""
    heading_error: float
    """rad; last magnetic correction before its gain"""
    window: float
    """s; averaging time of the specific force; 0 before the first average"""
    tilt_sigma: float
    """rad; one sigma of the tilt about each horizontal axis, pi if unknown"""
    heading_sigma: float
    """rad; one sigma of the heading, pi if unknown"""
    magnetometer_disturbed: Number
    """-; 1 while the magnetic field is rejected and the heading comes from the gyro (and the GPS)"""
    gps_aided: Number
    """-; 1 while the ground velocity of the GPS corrects the tilt, 0 while airspeed and averages correct it"""

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Quaternion of r_ned_from_frd as (w, x, y, z)."""
        return self.quaternion_w, self.quaternion_x, self.quaternion_y, self.quaternion_z


class WingState(NamedTuple):
    """Wing motion from the encoders; angles are positive with the wing up."""

    time_us: Time
    """us; since boot"""
    angle_left: float
    """rad; flap angle"""
    angle_right: float
    """rad; flap angle"""
    rate_left: float
    """rad/s; flap rate"""
    rate_right: float
    """rad/s; flap rate"""
    phase: float
    """rad; mean of both wings, 0 to 2 pi proportional to time, 0 at the upward crossing of the stroke middle"""
    frequency: float
    """Hz; present stroke, from the last two strokes, or from the command while the wings follow it; 0 without
    flapping"""
    amplitude_left: float
    """rad; half the peak-to-peak angle of the last stroke"""
    amplitude_right: float
    """rad; half the peak-to-peak angle of the last stroke"""
    mean_angle: float
    """rad; middle of the last stroke, both wings"""
    downstroke_ratio: float
    """-; fraction of the downstroke in the last stroke, mean of both wings"""
    strokes: Number
    """-; full strokes since boot"""
    flapping: Number
    """-; 1 while a stroke is measured (without encoders: commanded), 0 otherwise"""
    downstroke_ratio_left: float
    """-; fraction of the downstroke in the last stroke of the left wing"""
    downstroke_ratio_right: float
    """-; fraction of the downstroke in the last stroke of the right wing"""
    valid_left: Number
    """-; 0 while the left encoder is rejected and replaced by the right one"""
    valid_right: Number
    """-; 0 while the right encoder is rejected and replaced by the left one"""
    missed_counts: Number
    """counts; missed by both encoders since boot, from their indices"""


class PowerState(NamedTuple):
    """Drive supply, averaged over whole PWM periods."""

    time_us: Time
    """us; since boot, end of the averaging window"""
    voltage: float
    """V; mean over the burst"""
    current: float
    """A; mean over the burst"""
    power: float
    """W; mean of the product V I over the burst, not the product of the means"""
    charge: float
    """C; drawn since boot"""
    energy: float
    """J; drawn since boot"""
    energy_per_stroke: float
    """J; energy of the last full stroke"""
    battery_remaining: float
    """-; 0 to 1, from the charge drawn and the open-circuit voltage"""
    open_circuit_voltage: float
    """V; open-circuit voltage of the battery: voltage plus voltage drop"""
    resistance: float
    """ohm; battery and leads, measured in flight once the current varies"""
    current_zero: float
    """A; estimated zero of the current sensor, already subtracted"""
    clipped: Number
    """-; number of battery updates (25 a second) with a saturated current sensor: power and charge are underestimated
    """


class DriveTorque(NamedTuple):
    """Torque of the wing drives from the strain gauges."""

    time_us: Time
    """us; since boot"""
    left: float
    """N m; positive in the direction of the upstroke"""
    right: float
    """N m; positive in the direction of the upstroke"""


class AirData(NamedTuple):
    """Airspeed and pressure altitude."""

    time_us: Time
    """us; since boot"""
    airspeed: float
    """m/s; true"""
    airspeed_rate: float
    """m/s^2; filtered"""
    dynamic_pressure: float
    """Pa; pitot minus static, filtered"""
    static_pressure: float
    """Pa; ambient"""
    temperature: float
    """K; ambient"""
    density: float
    """kg/m^3; of the air"""
    pressure_altitude: float
    """m; above the altitude at boot, unfiltered"""
    airspeed_variance: float
    """m^2/s^2; variance of the airspeed: noise, lag in gusts, zero and scale of the pitot"""
    innovation: float
    """Pa; last pitot reading minus the previous dynamic pressure, accepted or rejected"""
    innovation_variance: float
    """Pa^2; expected variance of the innovation"""


class Altitude(NamedTuple):
    """Altitude and climb rate from barometer and accelerometer."""

    time_us: Time
    """us; since boot"""
    altitude: float
    """m; above the altitude at boot, positive up"""
    climb_rate: float
    """m/s; positive up, mean over the last wing period"""
    accel_bias: float
    """m/s^2; bias of the vertical acceleration"""
    altitude_variance: float
    """m^2; variance of the altitude, including the barometer drift since boot"""
    climb_variance: float
    """m^2/s^2; variance of the climb rate"""
    innovation: float
    """m; last barometer innovation"""
    innovation_variance: float
    """m^2; expected variance of the innovation, 0 before the first and without a barometer"""


class Position(NamedTuple):
    """Horizontal position, ground velocity and wind."""

    time_us: Time
    """us; since boot"""
    north: float
    """m; from home"""
    east: float
    """m; from home"""
    v_north: float
    """m/s; ground velocity"""
    v_east: float
    """m/s; ground velocity"""
    wind_north: float
    """m/s; wind velocity over ground"""
    wind_east: float
    """m/s; wind velocity over ground"""
    latitude: float
    """rad; WGS-84, 0 before the first fix"""
    longitude: float
    """rad; WGS-84, 0 before the first fix"""
    position_variance: float
    """m^2; variance of the position, each axis, including the slow error of the receiver"""
    valid: Number
    """-; 1 once a fix set home"""
    velocity_variance: float
    """m^2/s^2; variance of the ground velocity, each axis"""
    wind_variance: float
    """m^2/s^2; variance of the wind, each axis, including errors of airspeed and heading"""
    innovation_north: float
    """m; position innovation of the last fix, accepted or rejected"""
    innovation_east: float
    """m; position innovation of the last fix"""
    innovation_v_north: float
    """m/s; velocity innovation of the last fix"""
    innovation_v_east: float
    """m/s; velocity innovation of the last fix"""
    place_innovation_variance: float
    """m^2; expected variance of the position innovation, each axis, 0 before the first"""
    velocity_innovation_variance: float
    """m^2/s^2; expected variance of the velocity innovation, each axis, 0 before the first"""


# --- setpoints and loop states ----------------------------------------------------------------------------


class Mode(IntEnum):
    """Flight modes; the values are part of the log and of the parameters.

    They must not be renumbered.
    """

    MANUAL = 1
    STABILIZED = 2
    ALTITUDE_HOLD = 3
    AUTO = 4
    RETURN = 5
    LAND = 6
    LOITER = 7
    OFFBOARD = 8


class Stage(IntEnum):
    """Flight stages from launch to landing."""

    ON_GROUND = 0
    WAIT_LAUNCH = 1
    CLIMB_OUT = 2
    EN_ROUTE = 3
    APPROACH = 4
    FLARE = 5
    LANDED = 6


class NavigationStatus(NamedTuple):
    """Setpoints of the navigation with mode and stage."""

    time_us: Time
    """us; since boot"""
    mode: Annotated[Mode, Wire("fixed32")]
    """-; flight mode"""
    stage: Annotated[Stage, Wire("fixed32")]
    """-; stage of the flight"""
    armed: Number
    """-; 1 if the wings may move"""
    item: Number
    """-; index of the active mission item"""
    distance: float
    """m; distance to the position of the item"""
    cross_track: float
    """m; distance from the leg, positive to its right"""
    altitude_setpoint: float
    """m; above the altitude at boot"""
    heading_setpoint: float
    """rad; course setpoint, -pi to pi"""
    frozen: Number
    """-; 1 while the altitude and pitch loops are frozen for an excitation"""


class AltitudeStatus(NamedTuple):
    """Altitude and climb loops: altitude to climb rate to throttle and pitch setpoint."""

    time_us: Time
    """us; since boot"""
    altitude_error: float
    """m; setpoint minus estimate"""
    climb_setpoint: float
    """m/s; positive up"""
    climb_error: float
    """m/s; setpoint minus estimate"""
    integral: float
    """-; throttle integrator of the climb loop"""
    throttle: float
    """-; 0 to 1, flapping"""
    pitch_setpoint: float
    """rad; positive nose up"""
    saturated: Number
    """-; 1 if the throttle is saturated"""


class HeadingStatus(NamedTuple):
    """Heading loop: heading to roll setpoint."""

    time_us: Time
    """us; since boot"""
    heading: float
    """rad; controlled angle: course over ground, or yaw without a position; -pi to pi"""
    heading_error: float
    """rad; setpoint minus measured, -pi to pi"""
    roll_setpoint: float
    """rad; positive right wing down"""
    saturated: Number
    """-; 1 if the bank is saturated"""


class PitchStatus(NamedTuple):
    """Pitch loop: pitch setpoint to elevator."""

    time_us: Time
    """us; since boot"""
    pitch_setpoint: float
    """rad; positive nose up"""
    pitch_error: float
    """rad; setpoint minus measured"""
    proportional: float
    """rad; proportional term of the elevator"""
    integral: float
    """rad; integral term of the elevator"""
    damping: float
    """rad; damping term of the elevator"""
    elevator: float
    """rad; positive pitches the nose up"""
    saturated: Number
    """-; 1 if the elevator is saturated"""


class RollStatus(NamedTuple):
    """Roll loop: roll setpoint to tail rudder and wing asymmetry."""

    time_us: Time
    """us; since boot"""
    roll_setpoint: float
    """rad; positive right wing down"""
    roll_error: float
    """rad; setpoint minus measured"""
    proportional: float
    """-; proportional term of the roll command"""
    integral: float
    """-; integral term of the roll command"""
    damping: float
    """-; damping term of the roll command"""
    roll_command: float
    """-; -1 to 1, positive rolls right"""
    saturated: Number
    """-; 1 if the roll command is saturated"""


class ExcitationStatus(NamedTuple):
    """Identification input as applied."""

    time_us: Time
    """us; since boot"""
    active: Number
    """-; 1 during a maneuver, including its settling times"""
    manoeuvre: Number
    """-; number of maneuvers since boot"""
    elevator: float
    """rad; increment of the elevator"""
    throttle: float
    """-; increment of the throttle"""
    rudder: float
    """rad; increment of the rudder"""
    aborted: Number
    """-; 1 if an envelope limit aborted the maneuver"""


class FlapCommand(NamedTuple):
    """Commanded stroke of the wing drives."""

    time_us: Time
    """us; since boot"""
    frequency: float
    """Hz; flapping frequency"""
    amplitude: float
    """rad; half the peak-to-peak stroke"""
    mean_angle: float
    """rad; middle of the stroke"""
    phase: float
    """rad; phase of the commanded stroke, 0 to 2 pi"""
    asymmetry: float
    """-; relative increase of the left stroke and decrease of the right stroke"""


class ActuatorCommand(NamedTuple):
    """Commands of the servos and the motor."""

    time_us: Time
    """us; since boot: time of the sensor frame it replies to"""
    wing_left: float
    """rad; commanded flap angle of the left wing servo (servo drives)"""
    wing_right: float
    """rad; commanded flap angle of the right wing servo (servo drives)"""
    throttle: float
    """-; 0 to 1, motor of a geared drive"""
    elevator: float
    """rad; positive pitches the nose up"""
    rudder: float
    """rad; positive yaws the nose right"""
    armed: Number
    """-; 1 if the wings may move"""


# --- flight computer --------------------------------------------------------------------------------------


class Calibration(IntEnum):
    """Kinds of calibration."""

    NONE = 0
    ACCELEROMETER = 1
    """at rest on each of six sides"""
    LEVEL = 2
    """accelerometer, level and at rest"""
    MAGNETOMETER = 3
    """rotation about all axes"""
    AIRSPEED_ZERO = 4
    """at rest with the pitot covered"""
    AIRSPEED = 5
    """in flight, over a circle or in opposite directions"""
    WINGS = 6
    """both wings at rest at a known angle"""
    BATTERY = 7
    """drives at rest, with a given voltage"""


class CalibrationStatus(NamedTuple):
    """Progress of a calibration, and result of the last one."""

    time_us: Time
    """us; since boot"""
    kind: Annotated[Calibration, Wire("fixed32")]
    """-; active or last calibration"""
    running: Number
    """-; 1 while samples are collected"""
    progress: float
    """-; 0 to 1"""
    calibration_count: Number
    """-; number of calibrations since boot, including this one"""
    succeeded: Number
    """-; 1 if the last completed calibration set its parameters"""
    residual: float
    """RMS residual of the result, in the unit of the sensor"""


class Failsafe(IntFlag):
    """Flags of present failures."""

    NONE = 0
    LINK_LOST = 1
    GPS_LOST = 2
    BATTERY_LOW = 4
    IMU_FAULT = 8
    FENCE = 16
    FENCE_NEAR = 32
    PILOT_LOST = 64
    BATTERY_CRITICAL = 128
    POSITION_LOST = 256
    PITOT_BLOCKED = 512
    MAG_DISTURBED = 1024
    ENCODER_LEFT = 2048
    ENCODER_RIGHT = 4096
    ACCEL_SATURATED = 8192
    BARO_REFUSED = 16384
    TAIL_JAMMED = 32768
    WING_JAMMED = 65536
    RECEIVER_LOST = 131072
    BARO_LOST = 262144


class Health(NamedTuple):
    """Failures and number of rejected samples."""

    time_us: Time
    """us; since boot"""
    failsafe: Annotated[int, Wire("fixed32")]
    """-; flags of `Failsafe`"""
    rejected_samples: Number
    """-; flags of `Failsafe`"""
    ticks: Number
    """-; ticks since boot"""


class VibrationStatus(NamedTuple):
    """Accelerometer vibration above 5 Hz, including that of the wings."""

    time_us: Time
    """us; since boot"""
    level_x: float
    """m/s^2; standard deviation along FRD x, over about 0.1 s"""
    level_y: float
    """m/s^2; along FRD y"""
    level_z: float
    """m/s^2; along FRD z"""
    clipped: Number
    """-; number of samples with a saturated axis since boot"""


class Breach(IntEnum):
    """Violated limit of a fence."""

    NONE = 0
    FLOOR = 1
    CEILING = 2
    BORDER = 3


class FenceState(NamedTuple):
    """Fence status of the vehicle and the plan, and the last breach."""

    time_us: Time
    """us; since boot"""
    outside: Number
    """-; 1 while outside"""
    breaches: Number
    """-; number of breaches since boot"""
    kind: Annotated[Breach, Wire("fixed32")]
    """-; limit violated by the last breach"""
    since: float
    """s; start of the last breach since boot"""


class TaskTiming(NamedTuple):
    """Run times of one processor, or of whole ticks, over the last second, measured by the board."""

    time_us: Time
    """us; since boot"""
    processor: Number
    """-; 0 attitude, 1 power, 2 main, 3 logger; 4 whole tick from the arrival of a frame, including the ground links
    """
    mean_us: float
    """us; mean run time of a tick"""
    worst_us: float
    """us; maximum run time of a tick"""
    overruns: Number
    """-; number of ticks longer than their period"""
