"""A stand-in for the world: a bird of point mass with quasi-steady lift and first-order attitude, and its sensors.

It has the right signs and roughly the right sizes, nothing more; the flight code must fly it before the real
physics is asked.
"""

from __future__ import annotations

import math

from avionics.messages import (
    BURST_LENGTH,
    ActuatorCommand,
    AdcBurst,
    EncoderSample,
    GpsFix,
    ImuSample,
    PressureSample,
    SensorFrame,
)

G = 9.80665
DT = 0.005
HOME = (0.83, 0.15)
MAG_NED = (0.21, 0.0, 0.43)
MASS, AREA, DENSITY = 0.359, 0.56, 1.225
LIFT_SLOPE, DRAG_0, DRAG_2 = 3.0, 0.16, 1.1
ALPHA_TRIM = 0.15
WIND = (0.0, 0.0)


class Bird:
    """State and sensors; wings follow their commands exactly."""

    def __init__(self, wind: tuple[float, float] = WIND) -> None:
        self.time_us = 1000
        self.north = self.east = 0.0
        self.altitude = 1.6
        self.speed, self.gamma = 0.0, 0.0
        self.pitch, self.pitch_rate, self.roll, self.roll_rate, self.yaw = 0.15, 0.0, 0.0, 0.0, 0.3
        self.wings = (0.2, 0.2)
        self.beat = 0.0
        self.wind = wind
        self.fixed = True
        self.flying = False
        self.v_before = (0.0, 0.0, 0.0)
        self.tick = 0
        self.gps_on = True
        self.launch_speed = 0.0

    def throw(self) -> None:
        """A push of 3.5 g up to 7 m/s begins."""
        self.fixed, self.flying, self.gamma = False, True, 0.05

    def velocity(self) -> tuple[float, float, float]:
        """Over ground, NED, m/s."""
        if not self.flying:
            return (0.0, 0.0, 0.0)
        flat = self.speed * math.cos(self.gamma)
        return (
            flat * math.cos(self.yaw) + self.wind[0],
            flat * math.sin(self.yaw) + self.wind[1],
            -self.speed * math.sin(self.gamma),
        )

    def advance(self, command: ActuatorCommand) -> None:
        """One tick of 5 ms under ``command``."""
        self.time_us += 5000
        self.tick += 1
        rate = 0.5 * (command.wing_left + command.wing_right - sum(self.wings)) / DT
        self.wings = (command.wing_left, command.wing_right)
        self.beat += (rate * rate - self.beat) * DT / 0.3
        self.v_before = self.velocity()
        if self.flying:
            self._fly(command)

    def _fly(self, command: ActuatorCommand) -> None:
        if self.launch_speed < 7.0:
            self.launch_speed = self.speed = self.speed + 35.0 * DT
            self._move()
            return
        dynamic = 0.5 * DENSITY * self.speed**2 * AREA
        alpha = max(-0.4, min(0.5, self.pitch - self.gamma))
        lift = dynamic * LIFT_SLOPE * alpha
        drag = dynamic * (DRAG_0 + DRAG_2 * alpha * alpha)
        thrust = 0.0105 * self.beat
        cut = max(self.speed, 3.0)
        self.speed += ((thrust * math.cos(alpha) - drag) / MASS - G * math.sin(self.gamma)) * DT
        up = (lift + thrust * math.sin(alpha)) * math.cos(self.roll) / MASS
        self.gamma += (up - G * math.cos(self.gamma)) / cut * DT
        moment = -60.0 * (alpha - ALPHA_TRIM) - 9.0 * self.pitch_rate + 70.0 * (command.elevator + 0.1)
        self.pitch_rate += moment * DT
        self.pitch += self.pitch_rate * DT
        asymmetry = self.asymmetry(command)
        self.roll_rate += (30.0 * command.rudder + 30.0 * asymmetry - 6.0 * self.roll_rate - 2.0 * self.roll) * DT
        self.roll += self.roll_rate * DT
        self.yaw += G * math.tan(self.roll) / cut * DT
        self._move()

    def _move(self) -> None:
        v = self.velocity()
        self.north += v[0] * DT
        self.east += v[1] * DT
        self.altitude -= v[2] * DT
        if self.altitude <= 0.0:
            self.altitude, self.flying, self.speed = 0.0, False, 0.0
            self.pitch_rate = self.roll_rate = 0.0

    def asymmetry(self, command: ActuatorCommand) -> float:
        """Share by which the left stroke is larger, as far as one sample tells."""
        swing = command.wing_left + command.wing_right
        return (command.wing_left - command.wing_right) / swing if abs(swing) > 0.5 else 0.0

    def rotation(self) -> tuple[tuple[float, float, float], ...]:
        """r_ned_from_frd."""
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        cp, sp = math.cos(self.pitch), math.sin(self.pitch)
        cy, sy = math.cos(self.yaw), math.sin(self.yaw)
        return (
            (cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy),
            (cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy),
            (-sp, sr * cp, cr * cp),
        )

    def frame(self) -> SensorFrame:
        """What the sensors say now."""
        r = self.rotation()
        v = self.velocity()
        accel = [(b - a) / DT for a, b in zip(self.v_before, v, strict=True)]
        force_ned = (accel[0], accel[1], accel[2] - G)
        force = [sum(r[i][j] * force_ned[i] for i in range(3)) for j in range(3)]
        mag = [sum(r[i][j] * MAG_NED[i] for i in range(3)) for j in range(3)]
        yaw_rate = G * math.tan(self.roll) / max(self.speed, 3.0) if self.flying else 0.0
        p = self.roll_rate - yaw_rate * math.sin(self.pitch)
        cr, sr = math.cos(self.roll), math.sin(self.roll)
        q = self.pitch_rate * cr + yaw_rate * math.cos(self.pitch) * sr
        rr = -self.pitch_rate * sr + yaw_rate * math.cos(self.pitch) * cr
        imu = ImuSample(self.time_us, *force, p, q, rr, *mag)
        counts = [round(angle * 2000 / (2 * math.pi)) for angle in self.wings]
        return SensorFrame(
            self.time_us,
            imu,
            EncoderSample(self.time_us, *counts),
            self.pressures() if self.tick % 4 == 0 else None,
            AdcBurst(self.time_us, (820,) * BURST_LENGTH, (612,) * BURST_LENGTH) if self.tick % 2 == 0 else None,
            None,
            self.fix(v) if self.gps_on and self.tick % 40 == 7 else None,
        )

    def pressures(self) -> PressureSample:
        """Counts of a barometer at 0.01 Pa, a pitot of +-248.84 Pa on 1638 to 14746, a thermometer at 0.01 K."""
        static = 101325.0 * (1.0 - 0.0065 * self.altitude / 288.15) ** 5.25588
        dynamic = 0.5 * DENSITY * self.speed**2
        share = (dynamic / 248.84 + 1.0) / 2.0
        return PressureSample(self.time_us, round(static * 100), round(1638 + share * 13108), 28815)

    def fix(self, v: tuple[float, float, float]) -> GpsFix:
        """A fix without noise."""
        latitude = HOME[0] + self.north / 6.38e6
        longitude = HOME[1] + self.east / (6.39e6 * math.cos(HOME[0]))
        return GpsFix(self.time_us, latitude, longitude, 300.0 + self.altitude, *v, 2.0, 3.0, 3, 9)
