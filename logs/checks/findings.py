"""Findings about a log, with their meaning and remedy by code."""

from __future__ import annotations

from typing import NamedTuple


class Finding(NamedTuple):
    """One fault of a log, or one fact that limits its use."""

    code: str
    """key of `CODES`"""
    severity: str
    """error: a number derived from it is wrong; warning: it may be; info"""
    topic: str
    """as in the source log"""
    start: float
    """s; since the log's first message"""
    end: float
    """s; since the log's first message"""
    value: float
    """size of the fault, in the unit of the text; NaN without one"""
    text: str

    @property
    def remedy(self) -> str:
        """What to do about it, in one line."""
        return CODES[self.code].remedy


class Code(NamedTuple):
    """Meaning of a code."""

    meaning: str
    remedy: str


CODES: dict[str, Code] = {
    "damaged": Code("the file is damaged or cut off", "repair a recording by wingbeat log recover"),
    "gap": Code("messages are missing", "check the logger's rate and storage; split the record there"),
    "rate_change": Code("the rate of a topic changes", "use the time stamps, not a constant rate"),
    "time_backwards": Code("time stamps decrease", "sort by time stamp; check the source of the stamps"),
    "time_repeated": Code("time stamps repeat", "drop repeated rows; the sensor is slower than the topic"),
    "time_skew": Code("one signal is late behind another", "shift it by this time before identification"),
    "clipping": Code("a sensor is at its range", "use a larger range or a soft mount"),
    "frozen": Code("a signal stops changing", "leave this part out; check the sensor's connection"),
    "never_valid": Code("a signal never has a valid value", "check the sensor and its driver before the next flight"),
    "rate_mismatch_flapping": Code(
        "flapping frequency and acceleration disagree", "correct the gear ratio or the counts per turn"
    ),
    "current_offset": Code("current at rest", "zero the current sensor; subtract this offset"),
    "gyro_offset": Code("angular rate at rest", "calibrate the gyroscope at rest before the flight"),
    "bias_step": Code("the offset of a sensor steps", "fit a bias for each side; check the sensor's mounting"),
    "sign": Code("an axis has the wrong sign", "correct the orientation of the sensor"),
    "unit": Code("a signal is in another unit than stated", "scale the signal by this factor"),
    "magnetic_interference": Code("the drive moves the magnetometer", "move it away from the power leads"),
    "position_jump": Code("the position jumps", "leave this moment out; check GPS glitches and filter resets"),
    "saturation": Code("an actuator is at its limit", "use a smaller excitation or retrim"),
    "vibration": Code("strong vibration at the IMU", "mount the IMU softly; see wingbeat log vibration"),
    "battery_sag": Code("the voltage drops under load", "use a battery with less resistance, or a charged one"),
    "boots": Code("the vehicle booted more than once in the file", "import it, and check each log"),
    "missing_topic": Code("a topic for identification is missing", "log it in the next flight"),
    "not_informative": Code("the inputs tell too little", "fly doublets or a multisine: wingbeat design"),
}
SEVERITIES = ("error", "warning", "info")
