"""Structural modes of an airframe, integrated between two sensor ticks and averaged as a modern IMU does.

Each mode is a linear oscillator (exact discretization at `INTERNAL_RATE`). Broadband forces, impacts of the drive
and periodic forces excite it with the square of the stroke rate: buffeting is proportional to dynamic pressure,
that of the stroke plus that of flight, and an impact's velocity to the square of the speed in a stroke of fixed
free play. The IMU senses the mode's velocity times its natural frequency as acceleration: that of a mode under
forces whose spectrum falls with the square of the frequency, as that of turbulence does. Far below its resonance a
structure is rigid and adds nothing. The IMU clips at the internal rate and averages over the tick, which is its
anti-alias filter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sim_bridge import observation as o
from sim_bridge.compiled import Bound, bound_values, clear, entry_point, exact, exact_inlined
from sim_bridge.observation import Observation
from sim_bridge.sensors.noise import CommonRows, NormalRows, SensorSeed, split
from sim_bridge.vectors import Floats
from sim_bridge.vehicles.vibration import ModeSpec, VibrationSpec
from wingbeat.constants import STANDARD_GRAVITY

INTERNAL_RATE = 4000.0
"""Hz; samples inside the IMU"""
LEVEL_TIME = 0.1
"""s; time constant of the mean square of the stroke rate"""
LONGEST_STROKE = 2.0
"""s; a longer time between two upper reversals is no stroke"""

# Memory of `_advance`: mean square of the stroke rate over that of the reference, last stroke rate, time since the
# upper reversal, period, scatter of this stroke, stroke phase.
LEVEL, RATE, SINCE, PERIOD, SCATTER, PHASE, MEMORY = 0, 1, 2, 3, 4, 5, 6


class Structure(NamedTuple):
    """Kernel arguments; m modes, n samples in a tick, k impacts per stroke, p periodic forces."""

    transition: Floats
    """(4, m); of q and its rate over an internal sample, row by row"""
    omega: Floats
    """(m,) rad/s; acceleration by the rate of q: the natural frequency"""
    shapes: Floats
    """(m, 6); translation -, rotation rad/m"""
    forces: Floats
    """(3, m); change of q' in a sample: noise m/s, impact m/s, periodic force m/s"""
    kick_phases: Floats
    """(k,)"""
    kick_shifts: Floats
    """(k,); shift of each phase in this stroke"""
    mesh_orders: Floats
    """(p,)"""
    isolator: Floats
    """(5,) coefficients b0, b1, b2, a1, a2; b0 = 0: none"""
    settings: Floats
    """(7,) internal sample s, reference rate rad/s, jitter, scatter, clipping m/s^2, rectification s^2/m, buffeting
    by the square of the airspeed s^2/m^2"""
    coupling: Floats
    """(3, 3) rad/s per m/s^2; gyroscope's response to specific force"""
    normals: Floats
    """(blocks, n, m); standard normal numbers drawn ahead"""
    stroke_normals: Floats
    """(blocks, 1 + k)"""
    modes: Floats
    """(3, m); q, its rate and acceleration"""
    filtered: Floats
    """(6, 4); isolator: last two inputs and outputs"""
    memory: Floats
    """(MEMORY,)"""
    motion: Floats
    """(6,); acceleration m/s^2 and angular velocity rad/s of the IMU in a sample"""
    sums: Floats
    """(9,); specific force and angular velocity, then the square of the acceleration, summed over the tick"""


class AirframeVibration:
    """Vibration of one flight; `shake` every tick."""

    def __init__(
        self,
        spec: VibrationSpec,
        modes: Mapping[str, ModeSpec],
        seed: SensorSeed,
        period: float,
        clipping: float,
        factor: float = 1.0,
    ) -> None:
        """Build the modes.

        Args:
            seed: of buffeting, scatter and the gyroscope's sensitivity.
            period: s; sensor tick.
            clipping: m/s^2; range of the accelerometer.
            factor: scales every excitation and both sensor errors.
        """
        unit, generator = split(seed)
        samples = max(1, round(period * INTERNAL_RATE))
        step, count, kicks = period / samples, len(modes), len(spec.kick_phases)
        parts = [_mode(mode, step, factor) for mode in modes.values()]
        sensitivity = math.radians(spec.g_sensitivity) / STANDARD_GRAVITY * factor
        normals, stroke_normals = NormalRows(generator, samples, count), NormalRows(generator, 1 + kicks)
        self._rows = CommonRows(normals, stroke_normals)
        self._bound = Bound(Structure(
            transition=_columns([part[0].ravel() for part in parts], 4),
            omega=np.array([part[1] for part in parts]),
            shapes=np.array([(*mode.translation, *mode.rotation) for mode in modes.values()]).reshape(count, 6),
            forces=_columns([part[2] for part in parts], 3),
            kick_phases=np.array(spec.kick_phases, dtype=np.float64),
            kick_shifts=np.zeros(kicks),
            mesh_orders=np.array(spec.mesh_orders, dtype=np.float64),
            isolator=_isolator(spec, step),
            settings=np.array((
                step, spec.reference_rate, spec.kick_jitter, spec.stroke_scatter, clipping,
                factor * 1e-6 * spec.rectification / STANDARD_GRAVITY, spec.airspeed_buffet,
            )),
            coupling=sensitivity * np.asarray(unit.standard_normal(9)).reshape(3, 3),
            normals=normals.rows,
            stroke_normals=stroke_normals.rows,
            modes=np.zeros((3, count)),
            filtered=np.zeros((6, 4)),
            memory=_initial_memory(),
            motion=np.zeros(6),
            sums=np.zeros(9),
        ))  # fmt: skip

    def shake(self, observation: Observation, flap_rate: float) -> Observation:
        """Return what the IMU observes, one tick after the last call.

        Args:
            observation: of the rigid body at the end of the tick; its specific force is the mean over it.
            flap_rate: rad/s; mean of both wings at the end of the tick.
        """
        observed = np.zeros(o.SIZE)
        observation.fill(observed)
        self.add_to(observed, flap_rate)
        return Observation.from_array(observation.time_us, observed)

    def add_to(self, observed: Floats, flap_rate: float) -> None:
        """Do the same to an observation in an array (`observation.SIZE`,)."""
        self._add_vibration(observed, flap_rate, self._rows.next_row(), self._bound)

    @cached_property
    def _add_vibration(self) -> Callable[[Floats, float, int, Bound], None]:
        return entry_point(add_vibration, np.zeros(o.SIZE), 0.0, 0, self._bound)


def _initial_memory() -> Floats:
    memory = np.zeros(MEMORY)
    memory[SINCE], memory[SCATTER] = LONGEST_STROKE, 1.0
    return memory


def _columns(vectors: list[Floats], size: int) -> Floats:
    """(size, m); contiguous in the modes, so that the compiler vectorizes over them."""
    return np.ascontiguousarray(np.array(vectors).reshape(len(vectors), size).T)


def _mode(mode: ModeSpec, step: float, factor: float) -> tuple[Floats, float, Floats]:
    """Return transition (2, 2), natural frequency in rad/s and forces (3,) of a mode."""
    from scipy.linalg import expm, solve_discrete_lyapunov  # for a flight with vibration only

    omega = math.tau * mode.frequency
    transition = expm(step * np.array(((0.0, 1.0), (-omega * omega, -2.0 * mode.damping * omega))))
    covariance = solve_discrete_lyapunov(transition, np.diag((0.0, 1.0)))
    per_unit = omega * math.sqrt(covariance[1, 1])  # RMS acceleration by unit steps of the rate
    forces = factor * np.array((mode.buffet / per_unit, mode.kick, mode.mesh * step))
    return transition, omega, forces


def _isolator(spec: VibrationSpec, step: float) -> Floats:
    """Return the transmissibility of a spring and damper as biquad coefficients (bilinear transform)."""
    if spec.isolator_frequency == 0.0:
        return np.zeros(5)
    from scipy.signal import bilinear  # takes half a second

    omega = math.tau * spec.isolator_frequency
    damped = 2.0 * spec.isolator_damping * omega
    b, a = bilinear((damped, omega * omega), (1.0, damped, omega * omega), 1.0 / step)
    return np.array((*b, a[1], a[2]))


@exact
def add_vibration(observed: Floats, flap_rate: float, at: int, bound: Bound) -> None:
    """Advance by a tick with the row ``at`` of the normal numbers; add the vibration to an observation."""
    s = bound_values(bound)
    samples = s.normals.shape[1]
    memory, motion, sums = s.memory, s.motion, s.sums
    first, force = memory[RATE], observed[o.FORCE : o.FORCE + 3]
    step, reference, clipping = s.settings[0], s.settings[1], s.settings[4]
    u, v, w = observed[o.V_AIR], observed[o.V_AIR + 1], observed[o.V_AIR + 2]
    flow = s.settings[6] * (u * u + v * v + w * w)
    clear(sums)
    for i in range(samples):
        rate = first + (flap_rate - first) * (i + 1) / samples
        relative = rate / reference
        memory[LEVEL] += step / LEVEL_TIME * (relative * relative - memory[LEVEL])
        impact = _stroke(rate, step, at, s)
        _move_modes(memory[LEVEL] * memory[SCATTER], flow, impact, _periodic(s), s.normals[at, i], s)
        _sum_modes(s.shapes, s.modes, motion)
        if s.isolator[0] != 0.0:
            _isolate(motion, s.isolator, s.filtered)
        for axis in range(3):
            sums[axis] += min(max(force[axis] + motion[axis], -clipping), clipping)
            sums[3 + axis] += motion[3 + axis]
            sums[6 + axis] += motion[axis] * motion[axis]
    memory[RATE] = flap_rate
    for axis in range(3):
        force[axis] = sums[axis] / samples + s.settings[5] * sums[6 + axis] / samples
    for axis in range(3):
        coupled = s.coupling[axis, 0] * force[0] + s.coupling[axis, 1] * force[1] + s.coupling[axis, 2] * force[2]
        observed[o.OMEGA + axis] += sums[3 + axis] / samples + coupled


@exact_inlined
def _periodic(s: Structure) -> float:
    total = 0.0
    for order in s.mesh_orders:
        total += math.cos(math.tau * order * s.memory[PHASE]) if s.memory[PERIOD] > 0.0 else 0.0
    return total


@exact_inlined
def _move_modes(level: float, flow: float, impact: int, periodic: float, normals: Floats, s: Structure) -> None:
    """Advance the modes by a sample; ``level`` of all forces by the stroke, ``flow`` of buffeting by the airspeed."""
    modes, transition, omega, forces = s.modes, s.transition, s.omega, s.forces
    for j in range(modes.shape[1]):
        q, v = modes[0, j], modes[1, j]
        deflection = transition[0, j] * q + transition[1, j] * v
        rate = (
            transition[2, j] * q
            + transition[3, j] * v
            + level * (forces[1, j] * impact + forces[2, j] * periodic)
            + (level + flow) * forces[0, j] * normals[j]
        )
        modes[0, j], modes[1, j] = deflection, rate
        modes[2, j] = omega[j] * rate


@exact_inlined
def _sum_modes(shapes: Floats, modes: Floats, motion: Floats) -> None:
    """Sum the motion of the modes at the IMU."""
    x, y, z, p, q, r = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(modes.shape[1]):
        rate, acceleration = modes[1, j], modes[2, j]
        x += shapes[j, 0] * acceleration
        y += shapes[j, 1] * acceleration
        z += shapes[j, 2] * acceleration
        p += shapes[j, 3] * rate
        q += shapes[j, 4] * rate
        r += shapes[j, 5] * rate
    motion[0], motion[1], motion[2], motion[3], motion[4], motion[5] = x, y, z, p, q, r


@exact_inlined
def _stroke(rate: float, step: float, at: int, s: Structure) -> int:
    """Advance the stroke phase by a sample; return the number of impacts in it."""
    memory = s.memory
    before = memory[PHASE]
    memory[SINCE] += step
    impacts = 0
    if memory[RATE] > 0.0 and rate <= 0.0:
        if memory[PERIOD] > 0.0:
            # The stroke was shorter than the one before: what is left of it happens now.
            for k in range(s.kick_phases.shape[0]):
                impacts += int(before < s.kick_phases[k] + s.kick_shifts[k])
        memory[PERIOD] = memory[SINCE] if memory[SINCE] < LONGEST_STROKE else 0.0
        memory[SINCE], before = 0.0, -1.0
        memory[SCATTER] = math.exp(s.settings[3] * s.stroke_normals[at, 0])
        for k in range(s.kick_phases.shape[0]):
            s.kick_shifts[k] = s.settings[2] * s.stroke_normals[at, 1 + k]
    memory[RATE] = rate
    if memory[PERIOD] == 0.0:
        return 0
    memory[PHASE] = now = memory[SINCE] / memory[PERIOD]
    for k in range(s.kick_phases.shape[0]):
        phase = s.kick_phases[k] + s.kick_shifts[k]
        impacts += int(before < phase <= now)
    return impacts


@exact_inlined
def _isolate(motion: Floats, isolator: Floats, filtered: Floats) -> None:
    """Pass translation and rotation (6,) through the soft mount."""
    for axis in range(6):
        memory, value = filtered[axis], motion[axis]
        result = (
            isolator[0] * value
            + isolator[1] * memory[0]
            + isolator[2] * memory[1]
            - isolator[3] * memory[2]
            - isolator[4] * memory[3]
        )
        memory[1], memory[0] = memory[0], value
        memory[3], memory[2] = memory[2], result
        motion[axis] = result
