"""Every message that crosses a module border of the flight computer, declared once.

Conventions of units and axes, and the types of fields, as in `wingbeat.message`.
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

# --- what enters from the ground ------------------------------------------------------------------------


class PilotSource(IntEnum):
    """Where the pilot's sticks come from; a greater value goes before a smaller one."""

    NONE = 0
    MANUAL_CONTROL = 1
    OVERRIDE = 2
    RECEIVER = 3


class PilotInput(NamedTuple):
    """The pilot's sticks; those of MANUAL_CONTROL are an input, the others follow from logged channels."""

    time_us: Time
    """us; since boot, when it was applied"""
    pitch: float
    """-; -1 nose down to 1 nose up"""
    roll: float
    """-; -1 left to 1 right"""
    yaw: float
    """-; -1 left to 1 right"""
    throttle: float
    """-; 0 to 1 flapping"""
    source: Annotated[PilotSource, Wire("fixed32")] = PilotSource.MANUAL_CONTROL
    """-; where they come from"""


OVERRIDDEN = 18
"""channels of RC_CHANNELS_OVERRIDE"""


class ChannelOverride(NamedTuple):
    """RC_CHANNELS_OVERRIDE: channels that a ground station sets instead of a receiver."""

    time_us: Time
    """us; since boot, when it was applied"""
    pulses: Annotated[tuple[int, ...], Wire("fixed32", OVERRIDDEN)]
    """us; pulse widths, 0 to release a channel, 65535 to leave it as it was"""


class CommandKind(IntEnum):
    """What a `Command` asks for."""

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
    """One input from outside, applied at the start of the tick it is logged with."""

    time_us: int
    """us; since boot, the tick at which it is applied"""
    kind: CommandKind
    """-; what is asked"""
    name: str = ""
    """-; the parameter's name, the mode's name, what to calibrate (empty to cancel), or empty; LOITER for a
    CHANGE_ALTITUDE that enters this mode if the vehicle circles in none"""
    value: float = 0.0
    """-; the parameter's value, the item's number, what a calibration is given, the altitude above home in m for
    CHANGE_ALTITUDE, or 0"""
    payload: Any = None
    """-; mission items for SET_MISSION, a fence for SET_FENCE, rally points for SET_RALLY, an excitation item for
    EXCITE, a LOITER item for LOITER_AT, a setpoint for SET_SETPOINT, or for SET_MODE one to begin OFFBOARD with"""
    source: str = ""
    """-; who asked: a link's name, "script" or "pilot\""""


Input = Command | PilotInput | ChannelOverride
"""whatever enters a flight from outside, beside the sensors"""


# --- what the flight computer believes ------------------------------------------------------------------


class Attitude(NamedTuple):
    """Attitude, body rates and gyro bias from the AHRS."""

    time_us: Time
    """us; since boot"""
    roll: float
    """rad; right wing down is positive, -pi to pi"""
    pitch: float
    """rad; nose up is positive"""
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
    """rad; size of the last gravity correction before its gain"""
    heading_error: float
    """rad; last magnetic correction before its gain"""
    window: float
    """s; over which the specific force was averaged; 0 before the first average"""
    tilt_sigma: float
    """rad; one sigma of the tilt about each horizontal axis, pi when it is not known"""
    heading_sigma: float
    """rad; one sigma of the heading, pi when it is not known"""
    magnetometer_disturbed: Number
    """-; 1 while the magnetic field is refused and the heading is the gyro's (and the GPS's)"""
    gps_aided: Number
    """-; 1 while the ground velocity of the GPS tells the tilt, 0 while airspeed and averages do"""

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """-; of r_ned_from_frd, (w, x, y, z)"""
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
    """rad; of the mean of both wings, 0 to 2 pi in equal times, 0 at the upward crossing of the stroke's middle"""
    frequency: float
    """Hz; of the stroke that runs, by the last two, or by the command while wings follow it; 0 when not flapping"""
    amplitude_left: float
    """rad; half the peak-to-peak angle of the last stroke"""
    amplitude_right: float
    """rad; half the peak-to-peak angle of the last stroke"""
    mean_angle: float
    """rad; middle of the last stroke, both wings"""
    downstroke_ratio: float
    """-; downstroke's share of the last stroke, mean of both wings"""
    strokes: Number
    """-; full strokes since boot"""
    flapping: Number
    """-; 1 while a stroke is measured (without encoders: commanded), 0 otherwise"""
    downstroke_ratio_left: float
    """-; downstroke's share of the left wing's last stroke"""
    downstroke_ratio_right: float
    """-; downstroke's share of the right wing's last stroke"""
    valid_left: Number
    """-; 0 while the left encoder is not believed: its wing is taken to move as the other"""
    valid_right: Number
    """-; 0 while the right encoder is not believed: its wing is taken to move as the other"""
    missed_counts: Number
    """counts; missed by both encoders since boot, as their indices told"""


class PowerState(NamedTuple):
    """Supply of the wing drives, averaged over whole PWM periods."""

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
    """J; of the last full stroke"""
    battery_remaining: float
    """-; 0 to 1, from the charge drawn and the open-circuit voltage"""
    open_circuit_voltage: float
    """V; of the battery: the voltage plus its sag under the current"""
    resistance: float
    """ohm; of battery and leads, measured as the slope of that sag once the current varies"""
    current_zero: float
    """A; zero of the current sensor learned at rest, already taken off"""
    clipped: Number
    """-; looks at a burst, 25 a second, that found the current at the end of its sensor's range: all is too little"""


class DriveTorque(NamedTuple):
    """Torque of the wing drives from the strain gauges."""

    time_us: Time
    """us; since boot"""
    left: float
    """N m; positive when it drives the wing up"""
    right: float
    """N m; positive when it drives the wing up"""


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
    """m^2/s^2; of the airspeed: noise, gusts that it lags behind, zero and scale of the pitot"""
    innovation: float
    """Pa; last reading of the pitot less the dynamic pressure before it, refused or not"""
    innovation_variance: float
    """Pa^2; expected of the innovation"""


class Altitude(NamedTuple):
    """Altitude and climb rate from barometer and accelerometer."""

    time_us: Time
    """us; since boot"""
    altitude: float
    """m; above the altitude at boot, positive up"""
    climb_rate: float
    """m/s; positive up, mean over the last wing period"""
    accel_bias: float
    """m/s^2; of the vertical acceleration"""
    altitude_variance: float
    """m^2; of the altitude, the barometer's drift since boot included"""
    climb_variance: float
    """m^2/s^2; of the climb rate"""
    innovation: float
    """m; last barometer innovation"""
    innovation_variance: float
    """m^2; expected of the innovation, 0 before the first and without a barometer"""


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
    """m/s; velocity of the air over ground"""
    wind_east: float
    """m/s; velocity of the air over ground"""
    latitude: float
    """rad; WGS-84, 0 before the first fix"""
    longitude: float
    """rad; WGS-84, 0 before the first fix"""
    position_variance: float
    """m^2; of the place, each axis, the receiver's slow error included"""
    valid: Number
    """-; 1 once a fix set home"""
    velocity_variance: float
    """m^2/s^2; of the ground velocity, each axis"""
    wind_variance: float
    """m^2/s^2; of the wind, each axis, errors of airspeed and heading included"""
    innovation_north: float
    """m; of the last fix's place, refused or not"""
    innovation_east: float
    """m; of the last fix's place"""
    innovation_v_north: float
    """m/s; of the last fix's velocity"""
    innovation_v_east: float
    """m/s; of the last fix's velocity"""
    place_innovation_variance: float
    """m^2; expected of the innovation of the place, each axis, 0 before the first"""
    velocity_innovation_variance: float
    """m^2/s^2; expected of the innovation of the velocity, each axis, 0 before the first"""


# --- what it intends ------------------------------------------------------------------------------------


class Mode(IntEnum):
    """Flight modes; the values are part of the log and of the parameters, never renumber."""

    MANUAL = 1
    STABILIZED = 2
    ALTITUDE_HOLD = 3
    AUTO = 4
    RETURN = 5
    LAND = 6
    LOITER = 7
    OFFBOARD = 8


class Stage(IntEnum):
    """Where the flight is, from the hand to the ground."""

    ON_GROUND = 0
    WAIT_LAUNCH = 1
    CLIMB_OUT = 2
    EN_ROUTE = 3
    APPROACH = 4
    FLARE = 5
    LANDED = 6


class NavigationStatus(NamedTuple):
    """What the navigation asks for and why."""

    time_us: Time
    """us; since boot"""
    mode: Annotated[Mode, Wire("fixed32")]
    """-; flight mode"""
    stage: Annotated[Stage, Wire("fixed32")]
    """-; stage of the flight"""
    armed: Number
    """-; 1 when the wings may move"""
    item: Number
    """-; mission item being flown"""
    distance: float
    """m; to the item's place"""
    cross_track: float
    """m; off the leg, positive to the right of it"""
    altitude_setpoint: float
    """m; above the altitude at boot"""
    heading_setpoint: float
    """rad; course to fly, -pi to pi"""
    frozen: Number
    """-; 1 while the altitude and pitch loops are frozen for an excitation"""


class AltitudeStatus(NamedTuple):
    """Altitude and climb loops: altitude -> climb -> flapping and pitch setpoint."""

    time_us: Time
    """us; since boot"""
    altitude_error: float
    """m; setpoint minus estimate"""
    climb_setpoint: float
    """m/s; positive up"""
    climb_error: float
    """m/s; setpoint minus estimate"""
    integral: float
    """-; of the climb loop, in throttle"""
    throttle: float
    """-; 0 to 1, flapping"""
    pitch_setpoint: float
    """rad; nose up is positive"""
    saturated: Number
    """-; 1 when the throttle is at a limit"""


class HeadingStatus(NamedTuple):
    """Heading loop: heading -> roll setpoint."""

    time_us: Time
    """us; since boot"""
    heading: float
    """rad; what is steered: the course over ground, or the yaw without a position; -pi to pi"""
    heading_error: float
    """rad; setpoint minus measured, -pi to pi"""
    roll_setpoint: float
    """rad; right wing down is positive"""
    saturated: Number
    """-; 1 when the bank is at its limit"""


class PitchStatus(NamedTuple):
    """Pitch loop: pitch setpoint -> elevator."""

    time_us: Time
    """us; since boot"""
    pitch_setpoint: float
    """rad; nose up is positive"""
    pitch_error: float
    """rad; setpoint minus measured"""
    proportional: float
    """rad; of elevator"""
    integral: float
    """rad; of elevator"""
    damping: float
    """rad; of elevator"""
    elevator: float
    """rad; positive pitches the nose up"""
    saturated: Number
    """-; 1 when the elevator is at a limit"""


class RollStatus(NamedTuple):
    """Roll loop: roll setpoint -> tail rudder and wing asymmetry."""

    time_us: Time
    """us; since boot"""
    roll_setpoint: float
    """rad; right wing down is positive"""
    roll_error: float
    """rad; setpoint minus measured"""
    proportional: float
    """-; of roll command"""
    integral: float
    """-; of roll command"""
    damping: float
    """-; of roll command"""
    roll_command: float
    """-; -1 to 1, positive rolls right"""
    saturated: Number
    """-; 1 when the roll command is at a limit"""


class ExcitationStatus(NamedTuple):
    """The identification input as applied."""

    time_us: Time
    """us; since boot"""
    active: Number
    """-; 1 while a manoeuvre runs, its settling time included"""
    manoeuvre: Number
    """-; counts the manoeuvres since boot"""
    elevator: float
    """rad; added to the elevator"""
    throttle: float
    """-; added to the throttle"""
    rudder: float
    """rad; added to the rudder"""
    aborted: Number
    """-; 1 when an envelope limit ended the manoeuvre"""


class FlapCommand(NamedTuple):
    """The stroke asked of the wing drives."""

    time_us: Time
    """us; since boot"""
    frequency: float
    """Hz; flapping"""
    amplitude: float
    """rad; half the peak-to-peak stroke"""
    mean_angle: float
    """rad; middle of the stroke"""
    phase: float
    """rad; of the commanded stroke, 0 to 2 pi"""
    asymmetry: float
    """-; share by which the right wing's stroke is smaller and the left wing's larger"""


class ActuatorCommand(NamedTuple):
    """What goes to the servos and the motor."""

    time_us: Time
    """us; since boot: the sensor time it answers"""
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
    """-; 1 when the wings may move"""


# --- about the flight computer itself -------------------------------------------------------------------


class Calibration(IntEnum):
    """What can be calibrated."""

    NONE = 0
    ACCELEROMETER = 1
    """on six sides, at rest on each"""
    LEVEL = 2
    """accelerometer, level and at rest"""
    MAGNETOMETER = 3
    """while it is turned about all axes"""
    AIRSPEED_ZERO = 4
    """at rest, the pitot covered"""
    AIRSPEED = 5
    """in flight, over a circle or both ways"""
    WINGS = 6
    """both wings at rest at a known angle"""
    BATTERY = 7
    """the drives at rest, a voltage given"""


class CalibrationStatus(NamedTuple):
    """How a calibration goes, and how the last one ended."""

    time_us: Time
    """us; since boot"""
    kind: Annotated[Calibration, Wire("fixed32")]
    """-; that runs, or that ended last"""
    running: Number
    """-; 1 while samples are gathered"""
    progress: float
    """-; 0 to 1"""
    calibration_count: Number
    """-; calibrations since boot, this one included"""
    succeeded: Number
    """-; 1 when the last one that ended set its parameters"""
    residual: float
    """RMS that the found values leave, in the sensor's unit"""


class Failsafe(IntFlag):
    """Failures that are present."""

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
    """Failures, and counts of what was refused."""

    time_us: Time
    """us; since boot"""
    failsafe: Annotated[int, Wire("fixed32")]
    """-; flags of `Failsafe`"""
    rejected_samples: Number
    """-; sensor samples that were not finite or out of range"""
    ticks: Number
    """-; since boot"""


class VibrationStatus(NamedTuple):
    """Vibration of the accelerometer above 5 Hz, the wings' own included."""

    time_us: Time
    """us; since boot"""
    level_x: float
    """m/s^2; standard deviation along FRD x, over about 0.1 s"""
    level_y: float
    """m/s^2; along FRD y"""
    level_z: float
    """m/s^2; along FRD z"""
    clipped: Number
    """-; samples with an axis at the end of the range since boot"""


class Breach(IntEnum):
    """What of a fence was passed."""

    NONE = 0
    FLOOR = 1
    CEILING = 2
    BORDER = 3


class FenceState(NamedTuple):
    """Whether the flight is outside of the vehicle's or the plan's fence, and how it last came to be."""

    time_us: Time
    """us; since boot"""
    outside: Number
    """-; 1 while it is"""
    breaches: Number
    """-; since boot"""
    kind: Annotated[Breach, Wire("fixed32")]
    """-; of the last one"""
    since: float
    """s; since boot, when the last one began"""


class TaskTiming(NamedTuple):
    """Run times of one processor, or of whole ticks, over the last second, as the board measured them."""

    time_us: Time
    """us; since boot"""
    processor: Number
    """-; 0 attitude, 1 power, 2 main, 3 logger; 4 the whole tick, from a frame's arrival on, with the ground links"""
    mean_us: float
    """us; mean run time of a tick"""
    worst_us: float
    """us; longest run time of a tick"""
    overruns: Number
    """-; ticks longer than their period"""
