"""Mission files of the ground."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from avionics.guidance.mission import ItemKind
from avionics.link.vehicle import Home
from groundstation.link import waypoints
from groundstation.link.missions import Item
from wingbeat.errors import InputError

single = st.integers(-9999, 9999).map(lambda n: n / 8)
items = st.builds(
    Item,
    st.sampled_from([0, 1, 2, 3, 6]),
    st.integers(0, 65535),
    st.tuples(single, single, single, single),
    st.integers(-900_000_000, 900_000_000),
    st.integers(-1_800_000_000, 1_800_000_000),
    single,
    st.integers(0, 1),
)


@given(st.lists(items, min_size=1, max_size=5))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_what_is_written_is_read(tmp_path: Path, mission: list[Item]) -> None:
    path = tmp_path / "flight.waypoints"
    path.unlink(missing_ok=True)
    waypoints.write(path, mission)
    read = waypoints.read(path)
    for written, again in zip(mission, read, strict=True):
        assert again[:3] == written[:3] and again[5:] == written[5:]
        # Local coordinates keep their four decimals in the file, degrees seven.
        assert abs(again.x - written.x) <= 1 and abs(again.y - written.y) <= 1


def test_degrees_are_exact(tmp_path: Path) -> None:
    item = Item(3, 16, (0.0, 0.0, 0.0, 0.0), 389_901_234, -769_412_345, 40.0)
    waypoints.write(tmp_path / "a.waypoints", [item])
    assert waypoints.read(tmp_path / "a.waypoints") == (item,)


def test_our_own_missions_are_read_in_the_local_frame(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text('[[item]]\nkind = "waypoint"\nnorth = 160\neast = -60.5\naltitude = 40\n')
    (item,) = waypoints.read(path)
    assert (item.frame, item.command) == (1, ItemKind.WAYPOINT)
    assert (item.x, item.y, item.z) == (1_600_000, -605_000, -40.0)


def test_an_existing_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.waypoints"
    path.write_text("precious")
    with pytest.raises(InputError, match="cannot write"):
        waypoints.write(path, [Item(3, 16, (0.0,) * 4, 0, 0, 0.0)])  # type: ignore[arg-type]
    assert path.read_text() == "precious"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "first line"),
        ("hello", "first line"),
        ("QGC WPL 110\n", "no items"),
        ("QGC WPL 110\n0 1 3 16", "line 2: a mission item has 12 columns, not 4"),
        ("QGC WPL 110\n\n0 1 3 sixteen 0 0 0 0 0 0 0 1", "line 3"),
        ("QGC WPL 110\n0 1 3 16 0 0 0 0 nan 0 0 1", "line 2: a coordinate is out of range"),
        ("QGC WPL 110\n0 1 3 16 0 0 0 0 500 0 0 1", "line 2: a coordinate is out of range"),
        ("QGC WPL 110\n0 1 3 16 0 0 0 0 0 0 inf 1", "line 2: the altitude"),
        ("QGC WPL 110\n0 1 300 16 0 0 0 0 0 0 0 1", "line 2: frame"),
    ],
)
def test_a_malformed_file_names_the_line(text: str, part: str, tmp_path: Path) -> None:
    path = tmp_path / "a.waypoints"
    path.write_text(text)
    with pytest.raises(InputError, match=part):
        waypoints.read(path)


def test_a_takeoff_that_comes_back_without_its_place_is_the_same_one_with_another_is_not() -> None:
    placed = Item(6, int(ItemKind.TAKEOFF), (0.0, 0.0, 0.0, 0.0), 389_901_234, -769_412_345, 30.0)
    bare = placed._replace(x=0, y=0)
    assert waypoints.differences([placed, bare], [bare, placed]) == []
    assert waypoints.differences([placed], [placed._replace(x=placed.x + 100)])
    assert waypoints.differences([placed], [bare._replace(z=31.0)])
    point = placed._replace(command=int(ItemKind.WAYPOINT))
    assert waypoints.differences([point], [point._replace(x=0, y=0)])


def test_metres_from_home_and_degrees_are_the_same_place() -> None:
    home = Home(math.radians(38.99), math.radians(-76.94), 100.0)
    circuit = Path(__file__).parents[2] / "avionics" / "missions" / "circuit.toml"
    local = waypoints.read_upload(circuit, waypoints.convention_of(0)).mission
    globe = waypoints.read_upload(circuit, waypoints.convention_of(12), home).mission
    assert any(map(waypoints.is_local, local)) and not any(map(waypoints.is_local, globe))
    assert waypoints.differences(local, globe)
    placed = [waypoints.on_globe(item, home) for item in local]
    assert waypoints.differences(placed, globe) == []
    moved = [item._replace(x=item.x + 1000) if item.command == 16 else item for item in placed]
    assert waypoints.differences(moved, globe)
