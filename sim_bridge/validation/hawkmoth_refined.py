"""The hawkmoth's stroke on finer lattices and with other wakes: how far the comparison's numbers hang on either."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from sim_bridge.flight_mechanics.hawkmoth import CASES, HawkmothCase
from sim_bridge.validation.hawkmoth_lattice import MESH, STROKES, Course, Mesh, lattice_course, lattice_history
from sim_bridge.validation.row import Row, compared, figure

CUT = "the same lattice, cut otherwise: what the mesh leaves open"
SHED = "the same lattice, its wake otherwise: what the wake model leaves open"


class Variant(NamedTuple):
    """Refinement of `MESH` with its prescribed wake of two strokes."""

    title: str
    why: str
    mesh: Mesh = MESH
    wake: str = "prescribed"
    kept: float = 2.0
    core: float = 0.03


VARIANTS = (
    Variant(
        "half the panels each way, half the steps", CUT, Mesh(MESH.rows // 2, MESH.columns // 2, MESH.steps // 2)
    ),
    Variant("twice the panels each way", CUT, Mesh(2 * MESH.rows, 2 * MESH.columns, MESH.steps)),
    Variant("twice the steps", CUT, MESH._replace(steps=2 * MESH.steps)),
    Variant("twice the panels each way and the steps", CUT, Mesh(2 * MESH.rows, 2 * MESH.columns, 2 * MESH.steps)),
    Variant("free wake", SHED, wake="free"),
    Variant("wake cut off after half a stroke", SHED, kept=0.5),
    Variant("wake cut off after a stroke", SHED, kept=1.0),
    Variant("wake never cut off", SHED, kept=float(STROKES)),
    Variant("wake's cores a third as thick", SHED, core=0.01),
)


def refined_rows(on_progress: Callable[[float, str], None]) -> list[Row]:
    """Compare mean lift and power of the last stroke of each variant with those of `MESH`, at both speeds."""
    rows: list[Row] = []
    pairs = [(case, variant) for case in CASES for variant in VARIANTS]
    for done, (case, variant) in enumerate(pairs):
        on_progress(done / len(pairs), variant.title)
        plain = lattice_course(lattice_history(case))
        rows += _variant_rows(case, variant, plain)
    return rows


def _variant_rows(case: HawkmothCase, variant: Variant, plain: Course) -> list[Row]:
    v = variant
    computed = lattice_course(lattice_history(case, v.wake, v.mesh, v.kept, v.core))
    where = f"{MESH.rows} x {MESH.columns} panels, {MESH.steps} steps"
    return [
        compared(
            figure(where, f"hawkmoth at {case.airspeed:g} m/s, {v.title}: mean {name}", unit, float(one.mean())),
            float(other.mean()),
            v.why,
        )
        for name, unit, one, other in (
            ("lift", "N", plain.lift, computed.lift),
            ("power", "W", plain.power, computed.power),
        )
    ]
