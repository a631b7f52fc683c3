"""Lift of the wing that Yeo et al. measured: strip theory beside PteraSoftware's vortex lattice (``make bench``).

Ring vortices with the wake of two beats as they leave the edge, without separation and without a profile's drag; the
motion is the same, the outline too, without its outermost 3 %, where the chord ends.
"""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from rows import Row, leave, peer

from sim_bridge.validation import yeo

CHORDWISE, ACROSS, STEPS_A_BEAT, BEATS = 4, 7, 50, 3
PHASES = np.arange(1000) / 1000
PEAK = 0.5 * float(np.ptp(yeo.flap(PHASES)[:, 0]))
"""rad; half the way from the lowest to the highest flap angle"""


def shape(phase: float) -> float:
    """The measured motion from where it begins, in parts of `PEAK`."""
    beat = yeo.flap(np.array([phase / (2.0 * math.pi), 0.0]))[:, 0]
    return float(beat[0] - beat[1]) / PEAK


def lattice_lift() -> np.ndarray:
    """N; both wings over the last beat."""
    from flapping_pair import Flapping, Section, movement
    from pterasoftware.movements.movement import Movement
    from pterasoftware.movements.operating_point_movement import OperatingPointMovement
    from pterasoftware.operating_point import OperatingPoint
    from pterasoftware.problems import UnsteadyProblem
    from pterasoftware.unsteady_ring_vortex_lattice_method import UnsteadyRingVortexLatticeMethodSolver as Solver

    span = np.linspace(0.0, 0.97 * yeo.SEMISPAN, ACROSS)
    leading, trailing = yeo.edges(span)
    cuts = zip(span.tolist(), (leading[0] - leading).tolist(), (leading - trailing).tolist(), strict=True)
    beat = Flapping(float(yeo.flap(np.zeros(1))[0, 0]), PEAK, 1.0 / yeo.FREQUENCY, shape)
    tunnel = OperatingPoint(rho=yeo.DENSITY, vCg__E=yeo.AIRSPEED, alpha=0.0)
    flown = Movement(
        [movement([Section(*cut) for cut in cuts], beat, CHORDWISE)], OperatingPointMovement(tunnel),
        delta_time=1.0 / yeo.FREQUENCY / STEPS_A_BEAT, num_steps=BEATS * STEPS_A_BEAT, max_wake_cycles=2,
    )  # fmt: skip
    problem = UnsteadyProblem(flown)
    Solver(problem).run(calculate_streamlines=False, show_progress=False)
    # Wind axes: the third one points down.
    forces = [step.airplanes[0].forces_W for step in problem.steady_problems[-STEPS_A_BEAT:]]
    return -np.array(forces)[:, 2]


@pytest.mark.bench
def test_strip_theory_beside_a_vortex_lattice() -> None:
    """A stroke of ours is one of a hundred steps, of the lattice one of fifty."""
    pytest.importorskip("pterasoftware", reason="the package pterasoftware is not installed (extra `bench`)")
    measured, computed = yeo.measured_lift(), yeo.modelled_lift(yeo.section("fixed"))
    lattice_lift()
    begun = time.process_time()
    theirs = lattice_lift()
    spent = (time.process_time() - begun) / BEATS
    there = measured[:: yeo.STEPS // STEPS_A_BEAT]
    assert np.corrcoef(theirs, there)[0, 1] > 0.9, "the peer's motion or the sign of its lift is misunderstood"
    told = f"{peer('pterasoftware')}, {CHORDWISE} x {ACROSS - 1} panels a wing, {STEPS_A_BEAT} steps a stroke"
    leave(
        Row(
            "lift of Yeo's wing: RMS error",
            1e3 * yeo.rms(computed - measured),
            1e3 * yeo.rms(theirs - there),
            "mN",
            told,
        )
    )
    leave(Row("lift of Yeo's wing: time of a stroke", 1e3 * yeo.stroke_time(), 1e3 * spent, "ms", told))
