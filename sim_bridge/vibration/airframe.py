"""Structural modes of an airframe, integrated between two sensor ticks and averaged as a modern IMU does.

Each mode is a linear oscillator (exact discretization at `INTERNAL_RATE`). Broadband forces, impacts of the drive and
periodic forces excite it with the square of the stroke rate: buffeting is proportional to dynamic pressure, and an
impact's velocity to the square of the speed in a stroke of fixed free play. The IMU senses the mode's velocity times
its natural frequency as acceleration: that of a mode under forces whose spectrum falls with the square of the
frequency, as that of turbulence does. Far below its resonance a structure is rigid and adds nothing. The IMU clips at
the internal rate and averages over the tick, which is its anti-alias filter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from sim_bridge.compiled import Bound, bound_values, njit
from sim_bridge.observation import Observation, Vector
from sim_bridge.sensors.noise import BLOCK, SensorSeed, split
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
    """(m, 2, 2); of q and its rate over an internal sample"""
    omega: Floats
    """(m,) rad/s; acceleration by the rate of q: the natural frequency"""
    shapes: Floats
    """(m, 6); translation -, rotation rad/m"""
    forces: Floats
    """(m, 3); change of q' in a sample: noise m/s, impact m/s, periodic force m/s"""
    kick_phases: Floats
    """(k,)"""
    kick_shifts: Floats
    """(k,); shift of each phase in this stroke"""
    mesh_orders: Floats
    """(p,)"""
    isolator: Floats
    """(5,) coefficients b0, b1, b2, a1, a2; b0 = 0: none"""
    settings: Floats
    """(6,) internal sample s, reference rate rad/s, jitter, scatter, clipping m/s^2, rectification s^2/m"""
    coupling: Floats
    """(3, 3) rad/s per m/s^2; gyroscope's response to specific force"""
    normals: Floats
    """(blocks, n, m); standard normal numbers drawn ahead"""
    stroke_normals: Floats
    """(blocks, 1 + k)"""
    modes: Floats
    """(m, 2); q and its rate"""
    filtered: Floats
    """(6, 4); isolator: last two inputs and outputs"""
    memory: Floats
    """(MEMORY,)"""
    out: Floats
    """(6,); specific force m/s^2 and vibration's angular velocity rad/s, averaged over the tick"""


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
        unit, self._generator = split(seed)
        samples = max(1, round(period * INTERNAL_RATE))
        step, count, kicks = period / samples, len(modes), len(spec.kick_phases)
        parts = [_mode(mode, step, factor) for mode in modes.values()]
        sensitivity = math.radians(spec.g_sensitivity) / STANDARD_GRAVITY * factor
        self._at = BLOCK
        self._structure = Structure(
            transition=np.array([part[0] for part in parts]).reshape(count, 2, 2),
            omega=np.array([part[1] for part in parts]),
            shapes=np.array([(*mode.translation, *mode.rotation) for mode in modes.values()]).reshape(count, 6),
            forces=np.array([part[2] for part in parts]).reshape(count, 3),
            kick_phases=np.array(spec.kick_phases, dtype=np.float64),
            kick_shifts=np.zeros(kicks),
            mesh_orders=np.array(spec.mesh_orders, dtype=np.float64),
            isolator=_isolator(spec, step),
            settings=np.array((
                step, spec.reference_rate, spec.kick_jitter, spec.stroke_scatter, clipping,
                factor * 1e-6 * spec.rectification / STANDARD_GRAVITY,
            )),
            coupling=sensitivity * np.asarray(unit.standard_normal(9)).reshape(3, 3),
            normals=np.empty((BLOCK, samples, count)),
            stroke_normals=np.empty((BLOCK, 1 + kicks)),
            modes=np.zeros((count, 2)),
            filtered=np.zeros((6, 4)),
            memory=_initial_memory(),
            out=np.zeros(6),
        )  # fmt: skip
        self._bound = Bound(self._structure)

    def shake(self, observation: Observation, flap_rate: float) -> Observation:
        """Return what the IMU observes, one tick after the last call.

        Args:
            observation: of the rigid body; its specific force is the mean over the tick.
            flap_rate: rad/s; mean of both wings at the end of the tick.
        """
        if self._at == BLOCK:
            self._generator.standard_normal(out=self._structure.normals)
            self._generator.standard_normal(out=self._structure.stroke_normals)
            self._at = 0
        at = self._at
        self._at = at + 1
        _advance(observation.specific_force_frd, flap_rate, at, self._bound)
        x, y, z, p, q, r = self._structure.out.tolist()
        a, b, c = observation.omega_frd
        return observation._replace(specific_force_frd=(x, y, z), omega_frd=(a + p, b + q, c + r))


def _initial_memory() -> Floats:
    memory = np.zeros(MEMORY)
    memory[SINCE], memory[SCATTER] = LONGEST_STROKE, 1.0
    return memory


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


@njit(cache=True)
def _advance(force: Vector, flap_rate: float, at: int, bound: Bound) -> None:
    """Advance by a tick and fill ``out``."""
    s = bound_values(bound)
    samples, count = s.normals.shape[1], s.modes.shape[0]
    step, reference, clipping = s.settings[0], s.settings[1], s.settings[4]
    memory, out = s.memory, s.out
    first = memory[RATE]
    square = np.zeros(3)
    out[:] = 0.0
    for i in range(samples):
        rate = first + (flap_rate - first) * (i + 1) / samples
        relative = rate / reference
        memory[LEVEL] += step / LEVEL_TIME * (relative * relative - memory[LEVEL])
        impact = _stroke(rate, step, at, s)
        level = memory[LEVEL] * memory[SCATTER]
        periodic = 0.0
        for order in s.mesh_orders:
            periodic += math.cos(math.tau * order * memory[PHASE]) if memory[PERIOD] > 0.0 else 0.0
        motion = np.zeros(6)
        for j in range(count):
            mode, forces = s.modes[j], s.forces[j]
            q, v = mode[0], mode[1]
            mode[0] = s.transition[j, 0, 0] * q + s.transition[j, 0, 1] * v
            mode[1] = (
                s.transition[j, 1, 0] * q
                + s.transition[j, 1, 1] * v
                + level * (forces[0] * s.normals[at, i, j] + forces[1] * impact + forces[2] * periodic)
            )
            acceleration = s.omega[j] * mode[1]
            for axis in range(3):
                motion[axis] += s.shapes[j, axis] * acceleration
                motion[3 + axis] += s.shapes[j, 3 + axis] * mode[1]
        if s.isolator[0] != 0.0:
            _isolate(motion, s.isolator, s.filtered)
        for axis in range(3):
            square[axis] += motion[axis] * motion[axis]
            out[axis] += min(max(force[axis] + motion[axis], -clipping), clipping)
            out[3 + axis] += motion[3 + axis]
    memory[RATE] = flap_rate
    for axis in range(3):
        out[axis] = out[axis] / samples + s.settings[5] * square[axis] / samples
    for axis in range(3):
        coupled = s.coupling[axis, 0] * out[0] + s.coupling[axis, 1] * out[1] + s.coupling[axis, 2] * out[2]
        out[3 + axis] = out[3 + axis] / samples + coupled


@njit(cache=True)
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


@njit(cache=True)
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
