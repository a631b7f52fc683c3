"""A flapping aircraft with known derivatives, flown in the tests: linear forces under the wing's shaking."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from logs.identification.data.flight import Aircraft, FlightData
from logs.identification.data.maneuvers import Reference, find_maneuvers, reference_of
from logs.identification.estimators.flight_modes import (
    FILTER_ERROR,
    OUTPUT_ERROR,
    OUTPUTS,
    Fits,
    FlightProblem,
    first_problem,
    fit_derivatives,
    mode_of,
    records_of_flight,
)
from logs.identification.estimators.modal import Records
from logs.identification.estimators.output_error import output_error
from logs.identification.models.modes import Mode
from logs.identification.models.stroke_averaged import LONGITUDINAL, Matrices, matrices
from logs.identification.results import Array
from sim_bridge.compiled import njit
from wingbeat.constants import STANDARD_GRAVITY

REFERENCE = Reference(7.5, 1.6, 0.25, 7.67, elevator=0.05)
AIRCRAFT = Aircraft(imu_x=0.05, imu_z=0.0, tail_time_constant=0.04)
TRUTH = dict(
    zip(
        LONGITUDINAL,
        (-0.6, 0.5, 0.0, 0.0, -1.6, -4.5, -0.5, -3.0, 0.3, -9.0, -7.0, 60.0),
        strict=True,
    )
)
STEP = 0.005
SQUARED = 25.0
"""rad^2/s^2; mean square of the wings' rate"""


class Flight(NamedTuple):
    """How a test flight differs from the standard one."""

    seed: int = 0
    doublets: int = 6
    amplitude: float = 0.15
    width: float = 0.2
    settle: float = 1.2
    noise: float = 1.0
    shaking: float = 1.0
    modulation: float = 0.0
    aircraft: Aircraft = AIRCRAFT
    truth: dict[str, float] = TRUTH
    gust: float = 0.0
    """m/s; standard deviation along and across the steady flight, whatever the pitch is"""
    change: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """-, -, rad/m; what a gust across takes off u', w' and q' by its own change (wings' apparent mass and twist); of
    the gust across the steady flight, as the turning of the air is"""
    span: float = 0.0
    """m; of an aircraft that gusts turn the air under, as far as the span does not smooth it; 0: they do not"""
    growing: bool = False
    """-; whether moments and what a pitch rate does grow with the airspeed, what the tail does with its square"""
    flapping: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m/s^2, m/s^2, rad/s^2; what flapping of twice the mean square of the wings' rate adds to u', w' and q'"""
    slip: float = 0.0
    """m/s; standard deviation of a slip that swings, and rolls and yaws the aircraft as it does"""


def model_of(flight: Flight) -> Matrices:
    names = tuple(flight.truth)
    return matrices(names, np.array([flight.truth[n] for n in names]), REFERENCE, flight.aircraft)


def doublets(flight: Flight) -> tuple[Array, Array, Array]:
    """Excitation, active and number at every sample; a second of calm between the manoeuvres."""
    one = int(flight.width / STEP)
    settle, calm = int(flight.settle / STEP), int(1.0 / STEP)
    wave = np.concatenate((np.zeros(settle), np.full(one, 1.0), np.full(one, -1.0), np.zeros(settle), np.zeros(calm)))
    on = np.concatenate((np.ones(2 * settle + 2 * one), np.zeros(calm)))
    signs = [(-1.0) ** k for k in range(flight.doublets)]
    start = np.zeros(calm)
    excitation = np.concatenate([start, *[sign * wave for sign in signs]]) * flight.amplitude
    active = np.concatenate([start, *[on for _ in signs]])
    number = np.cumsum(np.diff(active, prepend=0.0) > 0).astype(float)
    return excitation, active, number


def wing_strokes(rng: np.random.Generator, count: int, jitter: float) -> Array:
    """Strokes at 4 Hz whose rate wanders by the relative ``jitter`` with a correlation of a quarter second."""
    white = rng.normal(size=count)
    wander = np.zeros(count)
    pole = np.exp(-STEP / 0.25)
    for k in range(1, count):
        wander[k] = pole * wander[k - 1] + np.sqrt(1 - pole**2) * jitter * white[k]
    return rng.uniform() + np.cumsum(4.0 * (1 + wander)) * STEP


def fly(flight: Flight) -> FlightData:
    """Fly it: linear forces and moments, a shaking locked to the wing's phase, and sensors with noise and biases."""
    rng = np.random.default_rng(flight.seed)
    excitation, active, number = doublets(flight)
    count = len(excitation)
    time = np.arange(count) * STEP
    strokes = wing_strokes(rng, count, 0.01 * flight.shaking)
    trim = 0.05
    command = trim + excitation
    harder = _harder(flight, active)
    states, tail, gust = _motion(flight, command - trim, strokes, harder)
    model = model_of(flight)
    turning = _turning(flight, gust)
    through_air = states.copy()
    through_air[:, :2] -= np.column_stack(_in_body(gust, states[:, 3]))
    faster = _faster(through_air[:, 0], through_air[:, 1]) if flight.growing else np.ones(count)
    outputs = through_air @ model.c.T + np.outer(tail * faster**2, model.d)
    grown = np.column_stack([_apparent(flight, tuple(column)) for column in _grown(flight)[:3].T])
    outputs += (faster - 1.0)[:, None] * (through_air @ grown.T)
    outputs += _swung(flight, strokes, through_air, faster)
    outputs -= np.outer(turning, _apparent(flight, _by_pitch_rate(flight)))
    outputs -= np.outer(_change(gust), _apparent(flight, flight.change))
    outputs += np.outer(harder, _apparent(flight, flight.flapping))
    outputs += flight.shaking * _shaking(2 * np.pi * strokes)
    noise = flight.noise * rng.normal(size=(4, count))
    speed = through_air[:, :2] + (REFERENCE.u, REFERENCE.w)
    return FlightData(
        time,
        outputs[:, 0] + 0.0066 * noise[0] + 0.004,
        outputs[:, 1] + 0.15 * noise[1] + STANDARD_GRAVITY * np.sin(REFERENCE.pitch),
        outputs[:, 2] + 0.15 * noise[2] - STANDARD_GRAVITY * np.cos(REFERENCE.pitch) + 0.05,
        outputs[:, 3] + REFERENCE.pitch,
        np.hypot(*speed.T) + 0.1 * noise[3],
        _climb(states),
        command,
        strokes,
        active,
        number,
        excitation,
        np.zeros(count),
    )  # fmt: skip


SWING, SWUNG = (2.0 * np.pi * 1.2, 0.15), 1.5
"""rad/s, -; frequency and damping of slip and roll; rad; how far it rolls for a slip as large as the airspeed"""
BANK = 0.1
"""rad; on the mean, of an aircraft that slips"""
STOPPED = 0.5
"""s; in which the side force would stop a slip"""


def _sideways(flight: Flight, count: int) -> Array:
    """Roll, its rate, that of yaw and the specific force along y (4, N), of an aircraft that gusts swing sideways."""
    frequency, damping = SWING
    pole = np.exp(STEP * frequency * complex(-damping, np.sqrt(1.0 - damping**2)))
    white = np.random.default_rng(flight.seed + 40_000).normal(size=count + 2000)
    swing = lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], white)[2000:]
    v = flight.slip * swing / np.std(swing)
    roll = BANK * np.sign(flight.slip) - SWUNG * v / REFERENCE.airspeed
    yaw_rate = -np.gradient(v, STEP) / REFERENCE.airspeed
    return np.array((roll, np.gradient(roll, STEP), yaw_rate, -v / STOPPED))


def _turned_aside(flight: Flight, count: int) -> Array:
    """What that adds to the rates (N, 4) of no pitch rate (Etkin, Dynamics of Atmospheric Flight, ch. 5)."""
    roll, p, r, a_y = _sideways(flight, count)
    v, lifted = -STOPPED * a_y, GRAVITY * np.cos(PITCH) * (np.cos(roll) - 1.0)
    return np.column_stack((r * v, lifted - p * v, np.zeros(count), -r * np.sin(roll)))


def _climb(states: Array) -> Array:
    """Rate (N,) of climb over ground, m/s."""
    u, w, pitch = states[:, 0] + REFERENCE.u, states[:, 1] + REFERENCE.w, states[:, 3] + REFERENCE.pitch
    climb: Array = u * np.sin(pitch) - w * np.cos(pitch)
    return climb


def _change(gust: Array) -> Array:
    """By how much the gust across changes until the next sample, m/s^2."""
    change: Array = np.diff(gust[:, 1], append=gust[-1, 1]) / STEP
    return change


@njit(cache=True)
def _faster(u, w):  # type: ignore[no-untyped-def]
    """Times the reference's airspeed, by what is above its ``u`` and ``w``."""
    return np.sqrt((u + REFERENCE.u) ** 2 + (w + REFERENCE.w) ** 2) / REFERENCE.airspeed


def _grown(flight: Flight) -> Array:
    """What (4, 4) of the rates by the states is proportional to the airspeed; zeros where nothing is."""
    motion = matrices(LONGITUDINAL, np.zeros(len(LONGITUDINAL)), REFERENCE, flight.aircraft).a
    grown: Array = (model_of(flight).a - motion) * flight.growing
    grown[:2, :2] = 0.0
    return grown


def _swung(flight: Flight, strokes: Array, through_air: Array, faster: Array) -> Array:
    """What (N, 4) the IMU feels of forces and moments that swing with the stroke, as they move the aircraft."""
    w, q = through_air[:, 1], through_air[:, 2]
    force, moment = flight.truth["Z_w"] * w, (flight.truth["M_w"] * w + flight.truth["M_q"] * q) * faster
    by_force, by_moment = _apparent(flight, (0.0, 1.0, 0.0)), _apparent(flight, (0.0, 0.0, 1.0))
    swing = flight.modulation * np.sin(2 * np.pi * strokes)
    return np.asarray(swing[:, None] * (np.outer(force, by_force) + np.outer(moment, by_moment)))


def _turning(flight: Flight, gust: Array) -> Array:
    """Pitch rate (N,) of the air in rad/s: q_g = -dw_g/dx, smoothed over 4 b / pi (MIL-F-8785C 3.7.5)."""
    if flight.span == 0.0:
        return np.zeros(len(gust))
    smoothing = 4.0 * flight.span / np.pi / REFERENCE.airspeed
    pole = np.exp(-STEP / smoothing)
    smoothed = lfilter([1.0 - pole], [1.0, -pole], gust[:, 1])
    turning: Array = -(gust[:, 1] - smoothed) / smoothing / REFERENCE.airspeed
    return turning


def _by_pitch_rate(flight: Flight) -> tuple[float, float, float]:
    """X_q, Z_q and M_q."""
    return flight.truth["X_q"], flight.truth["Z_q"], flight.truth["M_q"]


def _harder(flight: Flight, active: Array) -> Array:
    """How much harder than on the mean the wings flap (N,), as a height hold has them: anew in and behind each input.

    Without an effect of it they flap evenly.
    """
    if not any(flight.flapping):
        return np.zeros(len(active))
    part = np.cumsum(np.abs(np.diff(active, prepend=0.0)))
    drawn = np.random.default_rng(flight.seed + 30_000).uniform(-0.8, 0.8, int(part[-1]) + 1)
    harder: Array = np.asarray(drawn[part.astype(np.int64)], dtype=np.float64)
    return harder


def _apparent(flight: Flight, pushed: tuple[float, float, float]) -> Array:
    """Of the four outputs, by what is added to u', w' and q'."""
    along, across, turn = pushed
    return np.array([0.0, along + flight.aircraft.imu_z * turn, across - flight.aircraft.imu_x * turn, 0.0])


def _shaking(phase: Array) -> Array:
    """Pitch rate, specific forces and pitch at the flapping frequency and two harmonics: (N, 4)."""
    harmonics = np.column_stack([f(n * phase + 0.3 * n) for n in (1, 2, 3) for f in (np.sin, np.cos)])
    q = harmonics @ [1.2, 0.3, 0.4, -0.2, 0.1, 0.05]
    a_x = harmonics @ [3.0, 1.0, 4.0, 1.0, 0.5, 0.2]
    a_z = harmonics @ [-20.0, 8.0, 5.0, 3.0, 2.0, 1.0]
    pitch = harmonics @ [0.012, -0.048, 0.004, -0.008, 0.0, -0.001]
    return np.column_stack((q, a_x, a_z, pitch))


PITCH, GRAVITY = REFERENCE.pitch, STANDARD_GRAVITY


@njit(cache=True)
def _turned(x):  # type: ignore[no-untyped-def]
    """What the kinematics as they are add to those of small motion: products with the pitch rate, gravity's turn."""
    along_x = -x[1] * x[2] - GRAVITY * (np.sin(PITCH + x[3]) - np.sin(PITCH) - np.cos(PITCH) * x[3])
    along_z = x[0] * x[2] + GRAVITY * (np.cos(PITCH + x[3]) - np.cos(PITCH) + np.sin(PITCH) * x[3])
    return np.array([along_x, along_z, 0.0, 0.0])


@njit(cache=True)
def _in_body(gust, pitch):  # type: ignore[no-untyped-def]
    """Along and across an aircraft that is pitched up by ``pitch``, of a ``gust`` in the reference's axes."""
    sine, cosine = np.sin(pitch), np.cos(pitch)
    return cosine * gust[..., 0] - sine * gust[..., 1], sine * gust[..., 0] + cosine * gust[..., 1]


@njit(cache=True)
def _integrate(rates, constant, command, swings, start, air):  # type: ignore[no-untyped-def]
    """Midpoint rule, ten steps a sample; exact tail lag; Z_w, M_w and M_q swing with the stroke.

    ``rates`` are A, B and ``grown`` (4, 4), what of A is proportional to the airspeed: where it is zeros nothing is.
    ``swings`` are the strokes (N,) and by how much the three swing, ``air`` the gusts, what lessens the rates and by
    how much (N,) a bank lessens what a pitch rate adds to the pitch.
    """
    (a, b, grown), (strokes, modulation), (gust, less, level) = rates, swings, air
    fine = 10
    dt = STEP / fine
    half, whole = np.exp(-dt / 2 / constant), np.exp(-dt / constant)
    x, tail = start.copy(), 0.0
    states, tails = np.zeros((len(command), 4)), np.zeros(len(command))
    for k in range(len(command)):
        states[k], tails[k] = x, tail
        swing = 1 + modulation * np.sin(2 * np.pi * strokes[k])
        now = a.copy()
        now[1:3, 1] *= swing
        now[2, 2] *= swing
        along, across = _in_body(gust[k], x[3])
        push = b
        if np.any(grown):
            faster = _faster(x[0] - along, x[1] - across)
            swung = grown.copy()
            swung[2, 1:3] *= swing
            now += (faster - 1.0) * swung
            push = b * faster**2
        blown = -(now[:, 0] * along + now[:, 1] * across) - less[k]
        now[3, 2] += level[k]
        for _ in range(fine):
            middle = x + dt / 2 * (now @ x + push * tail + blown + _turned(x))
            between = command[k] + (tail - command[k]) * half
            x = x + dt * (now @ middle + push * between + blown + _turned(middle))
            tail = command[k] + (tail - command[k]) * whole
    return states, tails


def gusts(flight: Flight, count: int) -> Array:
    """Gusts (N, 2) along x and z in m/s: first-order colour with the length scales of MIL-F-8785C at 15 m."""
    white = np.random.default_rng(flight.seed + 20_000).normal(size=(count, 2))
    poles = np.exp(-STEP * REFERENCE.airspeed / np.array([90.0, 15.0]))
    return flight.gust * np.column_stack(
        [lfilter([np.sqrt(1 - pole**2)], [1.0, -pole], column) for pole, column in zip(poles, white.T, strict=True)]
    )


def _motion(flight: Flight, command: Array, strokes: Array, harder: Array) -> tuple[Array, Array, Array]:
    """States (N, 4), tail angle (N,) and gusts (N, 2); u and w are over ground."""
    rng = np.random.default_rng(flight.seed + 10_000)
    start = np.array([*rng.normal(0, 0.05, 3) * [1, 1, 0.2], 0.0])
    model = model_of(flight)
    constant = flight.aircraft.tail_time_constant
    gust = gusts(flight, len(command))
    less = np.outer(_change(gust), (*flight.change, 0.0)) - np.outer(harder, (*flight.flapping, 0.0))
    less += np.outer(_turning(flight, gust), (*_by_pitch_rate(flight), 0.0)) - _turned_aside(flight, len(command))
    rates, swings = (model.a, model.b, _grown(flight)), (strokes, flight.modulation)
    level = np.cos(_sideways(flight, len(command))[0]) - 1.0
    states, tails = _integrate(rates, constant, command, swings, start, (gust, less, level))
    return states, tails, gust


def flight_problem(
    data: FlightData,
    aircraft: Aircraft = AIRCRAFT,
    names: tuple[str, ...] = LONGITUDINAL,
    outputs: tuple[str, ...] = OUTPUTS,
) -> FlightProblem:
    maneuvers = find_maneuvers(data)
    return FlightProblem(maneuvers, reference_of(data, maneuvers), aircraft, names, outputs)


def fits_of(data: FlightData, aircraft: Aircraft = AIRCRAFT) -> tuple[FlightProblem, Fits]:
    problem = flight_problem(data, aircraft)
    return problem, fit_derivatives(problem)


def by_output_error(
    data: FlightData,
    aircraft: Aircraft = AIRCRAFT,
    names: tuple[str, ...] = LONGITUDINAL,
    outputs: tuple[str, ...] = OUTPUTS,
) -> Mode:
    problem = flight_problem(data, aircraft, names, outputs)
    return mode_of(OUTPUT_ERROR, problem, output_error(first_problem(problem)[1]))


def by_filter_error(data: FlightData, aircraft: Aircraft = AIRCRAFT) -> Mode:
    problem, fits = fits_of(data, aircraft)
    return mode_of(FILTER_ERROR, problem, fits.filter.fit)


def flight_records(data: FlightData) -> Records:
    """Stroke averages for the methods without a physical model."""
    return records_of_flight(flight_problem(data), AIRCRAFT.tail_time_constant or 0.0)
