"""What is promised for each failure, and on which flight it is held: the table of docs/reference/avionics.md.

Measured on the Robo Raven in still air, with its vibration, level at 15 m, the failure after 16 s of flight; a row
may hold in other phases of that flight too. To add a failure: its row in
`sim_bridge.flight.faults.FAULTS`, its row here; both are asked for by the tests.
"""

from __future__ import annotations

from typing import NamedTuple

LEVEL = "level"
PHASES = {"climb-out": 13.0, "level-off": 16.5, LEVEL: 24.0}
"""s since boot; of a failure in each phase of the flight to 15 m"""


class Promise(NamedTuple):
    """One row."""

    detection: str
    action: str
    reports: str
    """what an event says"""
    within: float
    """s; from the failure to those words"""
    bank: float = 30.0
    """deg; greatest"""
    altitude: tuple[float, float] | None = None
    """m; change of altitude that is not exceeded in the flight's time"""
    touchdown: bool = False
    """bank under 30 degrees and sink under 2 m/s"""
    stops: bool = False
    """the wings are at rest a second after the words"""
    follow_time: float = 20.0
    """s; after the failure"""
    phases: tuple[str, ...] = (LEVEL,)
    """phases of flight in which it may fail, see `PHASES`"""

    @property
    def words(self) -> str:
        """Text of the promise in the table."""
        parts = []
        if self.altitude is not None:
            low, high = self.altitude
            parts.append(f"bank under {self.bank:.0f} deg, altitude {low:+.0f} to {high:+.0f} m")
        if self.touchdown:
            parts.append("touchdown with bank under 30 deg, sink under 2 m/s")
        if self.stops:
            parts.append("flapping stops within 1 s")
        if not self.touchdown and self.altitude is None:
            parts.append("neither attitude nor touchdown can be promised")
        return "; ".join(parts)


_ENCODER = "counts constant while flapping is commanded, current and roll unchanged"
_JAM = "as above, but the drive current is that of a stalled motor, or one wing rolls the body"
_GLIDE = "stop flapping, wings level, LAND; the free wing moves to the angle of the jammed one"

PROMISES: dict[str, Promise] = {
    "gps_lost": Promise(
        "no fix for 2 s", "dead reckoning, hold the heading; LAND after 30 s more", "failsafe: GPS position lost",
        2.5, 10.0, (-2.0, 2.0),
    ),
    "pitot_blocked": Promise(
        "zero airspeed in motion, or in contradiction to ground velocity and stored wind; without fixes zero airspeed"
        " above the flare with flapping wings",
        "continue with that airspeed", "failsafe: airspeed invalid", 2.0, 10.0, (-4.0, 3.0),
    ),
    "mag_disturbed": Promise(
        "strength or dip of the field differs from its reference for 1 s", "continue with the gyro heading",
        "failsafe: magnetic field disturbed", 3.0, 10.0, (-2.0, 2.0),
    ),
    "encoder_left_lost": Promise(
        _ENCODER, "continue, the other wing represents both", "failsafe: left wing encoder lost", 2.5, 10.0,
        (-2.0, 2.0),
    ),
    "encoder_right_lost": Promise(
        _ENCODER, "continue, the other wing represents both", "failsafe: right wing encoder lost", 2.5, 10.0,
        (-2.0, 2.0),
    ),
    "imu_frozen": Promise(
        "10 equal samples in a row, or no plausible one for 0.2 s", "stop flapping, tail to its trim",
        "failsafe: flapping stopped, IMU samples rejected", 0.4, 180.0, None, stops=True, follow_time=5.0,
    ),
    "imu_saturated": Promise(
        "an axis of the accelerometer at the end of its range, 3 samples in a row",
        "attitude by gyro and compass, altitude by barometer; LAND", "failsafe: landing, accelerometer saturated",
        0.1, 30.0, None, touchdown=True, follow_time=45.0,
    ),
    "gyro_saturated": Promise(
        "an axis of the gyro at the end of its range for 0.2 s", "stop flapping, tail to its trim",
        "failsafe: flapping stopped, IMU samples rejected", 0.4, 180.0, None, stops=True, follow_time=5.0,
    ),
    "baro_spike": Promise(
        "gate of the altitude filter", "reject the sample", "failsafe: barometer rejected", 0.2, 10.0, (-2.0, 2.0)
    ),
    "baro_frozen": Promise(
        "static pressure the same for 0.5 s", "altitude by IMU and GPS; LAND",
        "failsafe: landing, barometer lost", 0.7, 30.0, None, touchdown=True, follow_time=45.0,
    ),
    "baro_lost": Promise(
        "no pressure sample for 0.5 s", "altitude by IMU and GPS, airspeed by GPS and stored wind; LAND",
        "failsafe: landing, barometer lost", 0.7, 30.0, None, touchdown=True, follow_time=45.0,
    ),
    "battery_low": Promise(
        "charge or open-circuit voltage: under 20 %", "RETURN", "failsafe: returning, battery low", 8.0,
        45.0, (-3.0, 27.0),
    ),
    "battery_critical": Promise(
        "the same: under 8 %", "LAND", "failsafe: landing, battery critical", 8.0, 45.0, None, touchdown=True,
        follow_time=45.0,
    ),
    "tail_jammed": Promise(
        "CUSUM test: no pitch acceleration by the elevator; in steady flight once the elevator has to move",
        "LAND by throttle alone, slowly, sinking at 0.8 m/s or less",
        "failsafe: landing, tail servo not responding", 8.0, 30.0, None, touchdown=True, follow_time=100.0,
        phases=tuple(PHASES),
    ),
    "wing_left_jammed": Promise(
        _JAM, _GLIDE, "failsafe: flapping stopped, wing jammed", 1.5, 30.0, None, touchdown=True, stops=True,
        follow_time=45.0,
    ),
    "wing_right_jammed": Promise(
        _JAM, _GLIDE, "failsafe: flapping stopped, wing jammed", 1.5, 30.0, None, touchdown=True, stops=True,
        follow_time=45.0,
    ),
    "time_backwards": Promise(
        "frame not later than the last, or over 1 s later",
        "reject, keep actuators; after 20 frames accept the new clock", "sensor clock", 0.2, 10.0, (-2.0, 2.0),
    ),
    "receiver_lost": Promise(
        "its own flag, a stick's pulse out of range, no frame for 0.5 s",
        "autopilot modes: continue; stick modes: neutral, LOITER, after 5 s RETURN; LAND if commanded before",
        "failsafe: receiver lost", 0.7, 10.0, (-2.0, 2.0),
    ),
    "sim_silent": Promise(
        "no sensor frame for 5 s of wall-clock time", "report the timeout, close the log, exit 2",
        "sent no sensor frame", 6.0, 0.0, None,
    ),
    "link_lost": Promise(
        "no message for 5 s from a station that was connected for 3 s or more; 5 s more on board",
        "RETURN; with receiver: continue",
        "failsafe: returning, ground link lost", 5.5, 45.0, (-3.0, 27.0),
    ),
}  # fmt: skip


def table() -> list[str]:
    """Rows of the table in docs/reference/avionics.md."""
    rows = [
        f"| `{name}` | {p.detection} | {p.action} | {', '.join(p.phases)} | {p.words} |"
        for name, p in PROMISES.items()
    ]
    return ["| failure | detected by | action | phases | promise |", "| --- | --- | --- | --- | --- |", *rows]
