"""What the tests of tuning share: the kept linear models, the designs on them, and loops written out by hand.

The loops here are arithmetic on A and B with exact delays; nothing of `sim_bridge.flight.tuning` is in them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from avionics.gains import FlightGains
from avionics.vehicles import FlightVehicle, load_vehicle
from sim_bridge.flight.tuning.cascade import Design, design
from sim_bridge.tuning.model import LinearModel, load_model

MODELS = Path(__file__).parents[1] / "data" / "models"
VEHICLES = ("robo_raven_ii_d", "arizona_100cm")
OMEGA = np.geomspace(0.005, 300.0, 5_000)
S = 1j * OMEGA

Complex = NDArray[np.complex128]


@cache
def model(name: str) -> LinearModel:
    return load_model(MODELS / f"{name}.toml")


@cache
def vehicle(name: str) -> FlightVehicle:
    return load_vehicle(name)


@cache
def designed(name: str) -> Design:
    return design(model(name), vehicle(name))


class Result(NamedTuple):
    gain_db: float
    phase_deg: float


def nearest(loop: Complex) -> Result:
    """Smallest gain margin (up or down) and phase margin of a sampled open loop, crossings between samples."""
    level = np.abs(loop)
    crossing = np.flatnonzero(np.diff(np.sign(level - 1.0)))
    turning = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[:-1] < 0.0))
    phase = np.degrees(np.abs(np.angle(-_between(loop, level - 1.0, crossing))))
    gain = 20.0 * np.abs(np.log10(np.abs(_between(loop, loop.imag, turning))))
    return Result(float(np.min(gain, initial=math.inf)), float(np.min(phase, initial=math.inf)))


def _between(loop: Complex, zero: NDArray[np.float64], at: NDArray[np.int64]) -> Complex:
    """The loop where ``zero`` changes its sign between samples ``at`` and the next, by linear interpolation."""
    share = zero[at] / (zero[at] - zero[at + 1])
    between: Complex = loop[at] + share * (loop[at + 1] - loop[at])
    return between


def loops(name: str, gains: FlightGains) -> dict[str, Complex]:
    """Every open loop of the cascade by name, at `OMEGA`, those inside it closed."""
    along, climbing = _longitudinal(name, gains)
    across, turning = _lateral(name, gains)
    wait = np.exp(-S * (0.005 + 0.01))
    climb_gains = gains.altitude
    correction = climb_gains.throttle_error + climb_gains.throttle_integral / S
    by_throttle, by_pitch = climbing
    mean = 1.0 / (1.0 + S / (2.0 * model(name).frequency))
    nose = climb_gains.pitch_error * by_pitch * wait
    climb = (correction * by_throttle * wait + nose) * mean
    ahead = (correction + climb_gains.throttle_climb) * by_throttle * wait + climb_gains.pitch_climb * by_pitch * wait
    ahead = ahead + nose
    return {
        "pitch": along,
        "roll": across,
        "climb": climb,
        "altitude": climb_gains.proportional / S * wait * ahead / (1.0 + climb),
        "heading": (gains.heading.proportional + gains.heading.integral / S) / S * wait * turning,
    }


def _longitudinal(name: str, gains: FlightGains) -> tuple[Complex, tuple[Complex, Complex]]:
    """The open pitch loop, and climb per throttle and per pitch setpoint with it closed."""
    m, p = model(name), gains.pitch
    drive = m.drive
    assert drive is not None
    by_elevator = _transfer(m.a, m.elevator)
    slope = 1.0
    if drive.input == "half_stroke":
        amplitudes, throttles = gains.flapping.amplitude_points, gains.flapping.throttle_points
        slope = (amplitudes[1] - amplitudes[0]) / (throttles[1] - throttles[0])
    by_throttle = _transfer(m.a, drive.b * slope) / (1.0 + drive.lag * S)
    w = 2.0 * math.pi * m.frequency
    notch = (S * S + w * w) / (S * S + 2.0 * p.notch_width * w * S + w * w)
    act = np.exp(-S * (0.005 + 0.005)) / (1.0 + vehicle(name).airframe.tail_time_constant * S)
    feedback = notch * (p.proportional + p.integral / S + p.damping * S)
    loop = act * feedback * by_elevator[3]
    climb_e, climb_t = (
        math.sin(m.pitch) * x[0] - math.cos(m.pitch) * x[1] + m.airspeed * x[3] for x in (by_elevator, by_throttle)
    )
    thrown = climb_t - climb_e * act * feedback * by_throttle[3] / (1.0 + loop)
    nosed = climb_e * act * (p.proportional + p.integral / S) / (1.0 + loop)
    return loop, (thrown, nosed)


def _lateral(name: str, gains: FlightGains) -> tuple[Complex, Complex]:
    """The open roll loop, and the heading's rate per roll setpoint with it closed."""
    m, r = model(name), gains.roll
    assert m.lateral is not None
    x = _transfer(m.lateral.a, m.lateral.rudder * gains.tail.rudder_share)
    act = np.exp(-S * (0.005 + 0.005)) / (1.0 + vehicle(name).airframe.tail_time_constant * S)
    correction = r.proportional + r.integral / S
    loop = act * (correction * x[3] + r.damping * x[1])
    return loop, act * correction * x[2] / math.cos(m.pitch) / (1.0 + loop)


def _transfer(a: NDArray[np.float64], b: NDArray[np.float64]) -> Complex:
    """(4, n); states per input."""
    matrices = S[:, None, None] * np.eye(4) - a
    return np.asarray(np.linalg.solve(matrices, np.broadcast_to(b[:, None], (len(S), 4, 1)))[:, :, 0].T)


LOST = 0.03
"""rad; far beyond a disturbance, short of what saturates"""


class Sampled:
    """A linear axis behind its servo, stepped by 1 ms, told a new command 200 times a second a tick late."""

    STEP = 0.001

    def __init__(self, a: NDArray[np.float64], b: NDArray[np.float64], servo: float, late: float = 0.005) -> None:
        from scipy.linalg import expm

        whole = np.zeros((6, 6))
        whole[:4, :4], whole[:4, 4] = a, b
        whole[4, 4:] = -1.0 / servo, 1.0 / servo
        self._step = expm(whole * self.STEP)
        self.x = np.zeros(6)
        self._waiting = [0.0] * round(late / self.STEP)

    def advance(self, command: float, seconds: float) -> None:
        for _ in range(round(seconds / self.STEP)):
            self._waiting.append(command)
            self.x[5] = self._waiting.pop(0)
            self.x = self._step @ self.x


def grows(fly: Callable[[float], float], duration: float = 60.0) -> bool:
    """Whether what ``fly`` gives at each 10 ms, called with the time, is lost or larger at the end than before."""
    seen = []
    for i in range(round(duration / 0.01)):
        seen.append(abs(fly(0.01 * i)))
        if seen[-1] > LOST:
            return True
    quarter = len(seen) // 4
    return bool(np.max(seen[3 * quarter :]) > np.max(seen[quarter : 2 * quarter]))
