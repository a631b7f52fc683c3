"""SVG picture of the wake of a flapping wing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sim_bridge.aerodynamics.vortex_lattice.geometry import Lattice, grid_of
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Snapshot
from sim_bridge.vectors import Floats

WIDTH, HEIGHT, MARGIN, HEAD, FOOT = 1100.0, 600.0, 50.0, 66.0, 60.0
"""px; HEAD for title and name of the vertical axis, FOOT for the numbers below"""
AZIMUTH, ELEVATION = math.radians(-58.0), math.radians(28.0)
"""of the camera: from ahead to the side, and above"""
THINNED = 2
"""number of wake rows that are drawn as one"""
STRONGEST = 0.98
"""-; quantile of the strengths at the ends of the color scale"""
NEGATIVE, NOTHING, POSITIVE = (0.0, 69.0, 120.0), (244.0, 244.0, 240.0), (170.0, 60.0, 0.0)
"""red, green, blue: blue and vermilion, distinguishable with color vision deficiency"""
NAMES = np.array([[-30.0, 42.0], [72.0, 24.0], [0.0, -16.0]])
"""px; distance of the axis names from the middles of the first two axes and the end of the third"""
WING = "#3a3f47"
STYLE = (
    'text{font:13px system-ui,-apple-system,"Segoe UI",Roboto,"Liberation Sans",sans-serif;fill:#1c2128}'
    ".title{font-size:16px;font-weight:600}path{fill:none;stroke:#8b939e;stroke-width:1}polygon{stroke-width:.4}"
)


def round_step(step: float) -> float:
    """Return the smallest of 1, 2 and 5 times a power of ten that is at least ``step``."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step * (1 - 1e-9))


def written(value: float, step: float) -> str:
    """Format a tick with the decimals of its step."""
    text = f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}".replace("-", "−")
    return text if abs(value) > 1e-9 * step else "0"


class Patch(NamedTuple):
    """Quadrilateral of wing or wake."""

    corners: Floats
    """(4, 3) m"""
    color: str


class View(NamedTuple):
    """Projection from meters to px."""

    scale: float
    """px/m"""
    shift: Floats
    """(2,) px"""

    def place(self, points: Floats) -> Floats:
        """(n, 2) px of points (n, 3) m."""
        return np.asarray(_turned(points)[:, :2] * (self.scale, -self.scale) + self.shift)


def wake_svg(lattice: Lattice, at: Snapshot, title: str) -> str:
    """Draw the lattice's first surface, its mirror image in y = 0 and both wakes.

    Lengths are from the foremost point of the wing, back, right and up.
    """
    nose = np.array([float(at.nodes[0].min()), 0.0, 0.0])
    wake, strengths = at.wake_nodes.transpose(1, 2, 0) - nose, at.wake_strengths
    limit = float(np.quantile(np.abs(strengths), STRONGEST)) or 1.0
    patches = [*_wake_patches(wake, strengths, limit), *_wing_patches(grid_of(lattice, at.nodes, 0) - nose)]
    box = _box(np.concatenate([patch.corners for patch in patches]))
    view = _view(box)
    patches.sort(key=lambda patch: float(_turned(patch.corners)[:, 2].mean()))
    drawn = "".join(_polygon(patch, view) for patch in patches)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {HEIGHT:g}" width="{WIDTH:g}"'
        f' height="{HEIGHT:g}" role="img"><title>{title}</title><style>{STYLE}</style>'
        f'<rect width="{WIDTH:g}" height="{HEIGHT:g}" fill="#fff"/><text class="title" x="{MARGIN:g}" y="28">{title}'
        f"</text>{_floor(box, view)}{drawn}{_axes(box, view)}{_key(limit)}</svg>\n"
    )


def shade(share: float) -> tuple[float, float, float]:
    """Return red, green and blue, 0 to 255, of a relative strength, -1 to 1."""
    end, much = (POSITIVE if share > 0.0 else NEGATIVE), min(abs(share), 1.0)
    red, green, blue = (a + much * (b - a) for a, b in zip(NOTHING, end, strict=True))
    return red, green, blue


def _hex(share: float) -> str:
    return "#" + "".join(f"{round(part):02x}" for part in shade(share))


def _wake_patches(nodes: Floats, strengths: Floats, limit: float) -> Iterator[Patch]:
    """Of ``nodes`` (R + 1, E, 3) and ``strengths`` (R, S), on both sides."""
    for i in range(0, len(strengths) - THINNED + 1, THINNED):
        for j in range(strengths.shape[1]):
            color = _hex(float(strengths[i : i + THINNED, j].mean()) / limit)
            corners = nodes[[i, i, i + THINNED, i + THINNED], [j, j + 1, j + 1, j]]
            yield from _both(corners, color)


def _wing_patches(grid: Floats) -> Iterator[Patch]:
    for i in range(grid.shape[0] - 1):
        for j in range(grid.shape[1] - 1):
            yield from _both(grid[[i, i, i + 1, i + 1], [j, j + 1, j + 1, j]], WING)


def _both(corners: Floats, color: str) -> Iterator[Patch]:
    yield Patch(corners, color)
    yield Patch(corners * np.array([1.0, -1.0, 1.0]), color)


def _turned(points: Floats) -> Floats:
    """(n, 3): right and up on the paper, and towards the eye, m."""
    a, e = AZIMUTH, ELEVATION
    eye = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])
    right = np.array([-math.sin(a), math.cos(a), 0.0])
    return np.asarray(points @ np.stack((right, np.cross(eye, right), eye)).T)


def _box(points: Floats) -> Floats:
    """(2, 3) m; round numbers about all points."""
    low, high = points.min(axis=0), points.max(axis=0)
    steps = np.array([round_step(max(float(b - a), 1e-6) / 5.0) for a, b in zip(low, high, strict=True)])
    return np.stack((np.floor(low / steps + 1e-9) * steps, np.ceil(high / steps - 1e-9) * steps))


def _view(box: Floats) -> View:
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    flat = _turned(corners)[:, :2] * (1.0, -1.0)
    low, room = flat.min(axis=0), np.ptp(flat, axis=0)
    space = np.array([WIDTH - 2.0 * MARGIN - 40.0, HEIGHT - HEAD - FOOT])
    scale = float((space / room).min())
    return View(scale, np.array([MARGIN + 20.0, HEAD]) - low * scale + 0.5 * (space - room * scale))


def _polygon(patch: Patch, view: View) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in view.place(patch.corners))
    edge = "#ffffff" if patch.color == WING else "#7a828d"
    return f'<polygon points="{points}" fill="{patch.color}" stroke="{edge}"/>'


def _floor(box: Floats, view: View) -> str:
    """The ground plane's outline and the posts behind."""
    (x0, y0, z0), (x1, y1, z1) = box
    edges = [((x0, y0, z0), (x1, y0, z0)), ((x1, y0, z0), (x1, y1, z0)), ((x1, y1, z0), (x0, y1, z0))]
    edges += [((x0, y1, z0), (x0, y0, z0)), ((x0, y0, z0), (x0, y0, z1))]
    return "".join(_stroke(np.array(edge), view) for edge in edges)


def _stroke(ends: Floats, view: View) -> str:
    (a, b), (c, d) = view.place(ends)
    return f'<path d="M{a:.1f} {b:.1f}L{c:.1f} {d:.1f}"/>'


def _axes(box: Floats, view: View) -> str:
    """Numbers and names along three edges: back and right on the floor in front, up at the left."""
    low, high = box
    back = ("behind the leading edge (m)", 0, np.array([0.0, low[1], low[2]]), (-8.0, 20.0))
    right = ("right (m)", 1, np.array([high[0], 0.0, low[2]]), (20.0, 12.0))
    up = ("up (m)", 2, np.array([low[0], low[1], 0.0]), (-10.0, 4.0))
    return "".join(_axis(name, axis, base, shift, box, view) for name, axis, base, shift in (back, right, up))


def _axis(name: str, axis: int, base: Floats, shift: tuple[float, float], box: Floats, view: View) -> str:
    step = round_step(float(box[1, axis] - box[0, axis]) / 4.0)
    ticks = step * np.arange(math.ceil(box[0, axis] / step - 1e-9), math.floor(box[1, axis] / step + 1e-9) + 1)
    points = np.tile(base, (len(ticks), 1))
    points[:, axis] = ticks
    anchor = "end" if axis == 2 else "middle"
    parts = [
        f'<text x="{x + shift[0]:.1f}" y="{y + shift[1]:.1f}" text-anchor="{anchor}">{written(tick, step)}</text>'
        for tick, (x, y) in zip(ticks.tolist(), view.place(points), strict=True)
    ]
    x, y = view.place(points[[0, -1]]).mean(axis=0) + NAMES[axis]
    if axis == 2:
        x, y = view.place(np.array([[box[0, 0], box[0, 1], box[1, 2]]]))[0] + NAMES[axis]
    return "".join(parts) + f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="middle">{name}</text>'


def _key(limit: float) -> str:
    """The colours and what they stand for."""
    left, width, top, count = MARGIN, 240.0, HEIGHT - 60.0, 40
    bars = "".join(
        f'<rect x="{left + width * i / count:.1f}" y="{top:g}" width="{width / count + 0.5:.1f}" height="10"'
        f' fill="{_hex(2.0 * (i + 0.5) / count - 1.0)}"/>'
        for i in range(count)
    )
    step = round_step(limit / 10.0)
    numbers = "".join(
        f'<text x="{left + width * share:.1f}" y="{top + 24:g}" text-anchor="middle">'
        f"{written(limit * (2.0 * share - 1.0), step)}</text>"
        for share in (0.0, 0.5, 1.0)
    )
    name = (
        f'<text x="{left + width / 2:.1f}" y="{top - 8:g}" text-anchor="middle">strength of the rings (m²/s)</text>'
    )
    return bars + numbers + name
