"""Forces of recorded wing motion: table, CSV text and page."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import RenderableType
from rich.table import Table as Grid

from logs.identification.findings import Finding
from logs.pages.document import MEASURED, MODEL, POINTS, Chapter, Plot, Remark, Series, Table
from sim_bridge.flight_mechanics.recorded_motion import RecordedMotion
from sim_bridge.flight_mechanics.tunnel import AirStream, TunnelForces, measured_means

COLUMNS = ("lift", "thrust", "side", "pitch_moment")
UNITS = ("N", "N", "N", "N m")
NUMBERS = ("advance ratio", "Reynolds number", "reduced frequency", "aspect ratio")


def forces_text(forces: TunnelForces) -> str:
    """Return the forces as CSV."""
    rows = zip(forces.time, *(getattr(forces, name) for name in COLUMNS), strict=True)
    lines = [",".join(("time", *COLUMNS)), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return "\n".join(lines) + "\n"


def forces_table(
    title: str, model: str, stream: AirStream, motion: RecordedMotion, forces: TunnelForces
) -> RenderableType:
    """Return means and peaks, measured means and similarity numbers as a table."""
    flown = f"{stream.airspeed:g} m/s, {motion.stroke_rate:.4g} Hz, air loads by {model}"
    grid = Grid(title=f"{title}\n{flown}", title_justify="left", box=None, padding=(0, 2))
    grid.add_column("")
    for head in ("mean", "least", "greatest", "measured mean", "difference"):
        grid.add_column(head, justify="right")
    measured = measured_means(motion)
    for name, unit in zip(COLUMNS, UNITS, strict=True):
        values = getattr(forces, name)
        mean, told = float(values.mean()), measured.get(name)
        cells = [f"{round(float(one), 12) + 0.0:.4g} {unit}" for one in (mean, values.min(), values.max())]
        if told is not None:
            cells += [f"{told:.4g} {unit}", f"{100.0 * (mean / told - 1.0):+.0f} %" if told else f"{mean - told:.4g}"]
        grid.add_row(name.replace("_", " "), *cells)
    for name, (lift, thrust) in forces.by_wing.items():
        numbers = zip(NUMBERS, forces.numbers[name], strict=True)
        told_numbers = ", ".join(f"{word} {value:.3g}" for word, value in numbers)
        grid.caption = "\n".join(
            (
                *((str(grid.caption),) if grid.caption else ()),
                f"{name}: mean lift {lift:.4g} N, thrust {thrust:.4g} N; {told_numbers}",
            )
        )
    grid.caption_justify = "left"
    return grid


def forces_page(
    forces: TunnelForces, motion: RecordedMotion, model: str, findings: Iterable[Finding]
) -> tuple[Chapter, ...]:
    """Return the chapters of the page: forces beside measured ones, wing angles, similarity numbers."""
    plots = []
    for name, unit in zip(COLUMNS, UNITS, strict=True):
        lines = [Series(model, forces.time, getattr(forces, name), MODEL)]
        if len(motion.measured.get(name, ())) > 1:
            lines.append(Series("measured", motion.measured_time, motion.measured[name], MEASURED, POINTS))
        plots.append(Plot(name.replace("_", " "), "time", "s", "all wings", unit, tuple(lines)))
    angles = tuple(
        Plot(
            f"angles of {name}",
            "time",
            "s",
            "angle",
            "rad",
            tuple(
                Series(label, motion.time, values[0], role)
                for (label, values), role in zip(
                    wing._asdict().items(), ("measured", "model", "truth", "other"), strict=True
                )
                if values[0].any()
            ),
        )
        for name, wing in motion.angles.items()
    )
    rows = tuple((name, *forces.by_wing[name], *forces.numbers[name]) for name in forces.by_wing)
    means = measured_means(motion)
    compared = Table(
        ("force", "mean, N", "measured mean, N"),
        tuple((name, float(getattr(forces, name).mean()), means.get(name)) for name in COLUMNS[:3]),
    )
    remarks = tuple(Remark(one.severity, one.code, one.text, one.remedy) for one in findings)
    wings = Table(("wing", "mean lift, N", "mean thrust, N", *NUMBERS), rows)
    return (
        Chapter("Forces", tables=(compared,), plots=tuple(plots), findings=remarks),
        Chapter("Wings", tables=(wings,), plots=angles),
    )
