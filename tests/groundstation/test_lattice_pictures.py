"""Pictures of the lattice: what is drawn of a wake, where on the paper, and files that are not overwritten."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from groundstation.command.main import main
from groundstation.views import lattice_pictures, wake_picture
from groundstation.views.lattice_pictures import LIFT, WAKE, draw_lattice, lift_plot
from groundstation.views.wake_picture import HEIGHT, WIDTH, shade, wake_svg
from sim_bridge.aerodynamics.vortex_lattice.geometry import Section, Surface, build_lattice
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Air, Scheme, Snapshot, run
from sim_bridge.validation.papers import PAPERS
from sim_bridge.validation.yeo import measured_lift
from wingbeat.errors import InputError

SVG = "{http://www.w3.org/2000/svg}"
ENDS = (Section((0.0, 0.1, 0.0), 0.3), Section((0.0, 1.0, 0.0), 0.2))
LATTICE = build_lattice([Surface("wing", ENDS, 2, (3,))])


def glided(steps: int = 7) -> Snapshot:
    seen: list[Snapshot] = []
    way = np.array([[-1.0], [0.0], [-0.1]])
    run(LATTICE, lambda t: LATTICE.nodes + t * way, Scheme(0.1, steps), Air(1.2, True), watch=seen.append)
    assert [len(one.wake_strengths) for one in seen] == list(range(steps))
    return seen[-1]


def test_a_wake_is_drawn_on_both_sides_and_inside_of_the_paper() -> None:
    at = glided()
    page = ElementTree.fromstring(wake_svg(LATTICE, at, "A glide"))
    rings, panels = 3 * (6 // wake_picture.THINNED), 6
    found = [shape.attrib for shape in page.iter(f"{SVG}polygon")]
    assert len(found) == 2 * (rings + panels)
    assert sum(one["fill"] == wake_picture.WING for one in found) == 2 * panels
    numbers = np.array([float(n) for one in found for n in re.split("[ ,]", one["points"])]).reshape(-1, 2)
    assert np.all(numbers > 0.0) and np.all(numbers < (WIDTH, HEIGHT))
    told = [text.text for text in page.iter(f"{SVG}text")]
    assert {"A glide", "right (m)", "up (m)", "behind the leading edge (m)", "strength of the rings (m²/s)"} <= set(
        told
    )


def test_the_colours_tell_sign_and_size_apart() -> None:
    assert shade(0.0) == wake_picture.NOTHING
    assert shade(1.0) == shade(3.0) == wake_picture.POSITIVE and shade(-1.0) == wake_picture.NEGATIVE
    assert shade(0.3)[2] > shade(0.9)[2] and shade(-0.3)[0] > shade(-0.9)[0]


def test_steps_are_one_two_or_five() -> None:
    assert [wake_picture.round_step(value) for value in (0.011, 0.2, 2.1, 501.0)] == pytest.approx(
        [0.02, 0.2, 5.0, 1000.0]
    )
    assert [wake_picture.written(value, 0.05) for value in (-0.1, 0.0)] == ["−0.10", "0"]


def test_a_picture_that_exists_is_kept(tmp_path: Path) -> None:
    (tmp_path / LIFT).write_text("mine")
    with pytest.raises(InputError, match=rf"{LIFT} exists: it is not overwritten"):
        draw_lattice(tmp_path, lambda share: None)
    assert (tmp_path / LIFT).read_text() == "mine" and not (tmp_path / WAKE).exists()


def test_the_lift_is_drawn_four_times_on_one_axis_and_the_wake_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at = glided()
    monkeypatch.setattr(lattice_pictures, "wake_course", lambda every, progress: [at])
    monkeypatch.setattr(lattice_pictures, "wing", lambda: LATTICE)
    monkeypatch.setitem(PAPERS, "lattice", PAPERS["lattice"]._replace(checks=()))
    assert main(["validate", "--only", "lattice", "--plots", str(tmp_path / "new")]) == 0
    text = (tmp_path / "new" / LIFT).read_text()
    for label in ("lift of both wings (N)", "measured", "strip theory", "vortex lattice with stall"):
        assert label in text
    assert np.array_equal(lift_plot().series[0].y, measured_lift()) and len(lift_plot().series) == 4
    assert ElementTree.fromstring((tmp_path / "new" / WAKE).read_text()).tag == f"{SVG}svg"
