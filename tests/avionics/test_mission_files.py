"""Mission files: what they may say, and that a bad one is refused with the item, the key and the range."""

import math
from pathlib import Path

import pytest

from avionics.guidance.mission import Channel, Excitation, ItemKind, MissionItem, Shape
from avionics.missions import check_mission, load_mission, load_plan, mission_names
from wingbeat.errors import InputError


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "mission.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_every_mission_that_comes_along_can_be_flown() -> None:
    assert "circuit" in mission_names()
    for name in mission_names():
        assert check_mission(load_mission(name)) == ""


def test_the_circuit_climbs_holds_flies_waypoints_excites_and_lands() -> None:
    mission = load_mission("circuit")
    kinds = [item.kind for item in mission]
    assert kinds[0] == ItemKind.TAKEOFF
    assert kinds[-1] == ItemKind.LAND
    assert {ItemKind.HOLD, ItemKind.WAYPOINT} <= set(kinds)
    excitations = [item.excitation for item in mission if item.excitation]
    widths = {excitation.width for excitation in excitations}
    assert len(widths) >= 3
    assert min(widths) <= 0.15
    assert max(widths) >= 0.4
    assert mission[0].altitude == 40.0
    assert mission[1].duration >= 5.0


def test_degrees_become_radians(tmp_path: Path) -> None:
    text = """
    [[item]]
    kind = "hold"
    altitude = 20
    heading_deg = 90
    duration = 3.5
    [[item]]
    kind = "excite"
    channel = "rudder"
    shape = "3211"
    amplitude_deg = 10
    width = 0.2
    settle = 1
    repeats = 2
    [[item]]
    kind = "return"
    """
    assert load_mission(written(tmp_path, text)) == (
        MissionItem(ItemKind.HOLD, altitude=20.0, heading=math.radians(90), duration=3.5),
        MissionItem(
            ItemKind.EXCITE,
            excitation=Excitation(Channel.RUDDER, Shape.MULTISTEP_3211, math.radians(10), 0.2, 1.0, 2),
        ),
        MissionItem(ItemKind.RETURN),
    )


GOOD = '[[item]]\nkind = "takeoff"\naltitude = 40\n'
EXCITE = 'kind = "excite"\nchannel = "elevator"\nshape = "doublet"\namplitude_deg = 5\nwidth = 0.2\nsettle = 1\n'


@pytest.mark.parametrize(
    ("text", "reports"),
    [
        (GOOD + '[[item]]\nkind = "takeoff"\naltitude = 4000', ["item 2", "altitude", "1 to 1000 m"]),
        (GOOD + '[[item]]\nkind = "takeoff"', ["item 2", "altitude is missing", "1 to 1000 m"]),
        (GOOD + '[[item]]\nkind = "takeoff"\naltitude = "high"', ["item 2", "(1 to 1000 m), not 'high'"]),
        (GOOD + '[[item]]\nkind = "takeoff"\naltitude = true', ["item 2", "altitude must be a number", "not True"]),
        (GOOD + '[[item]]\nkind = "takeoff"\naltitude = nan', ["item 2", "altitude"]),
        (GOOD + '[[item]]\nkind = "loop"', ["item 2", "kind", "loop", "waypoint"]),
        (GOOD + "[[item]]\naltitude = 3", ["item 2", "kind is missing"]),
        (GOOD + '[[item]]\nkind = "land"\nnorth = 0\neast = 0\nheading = 1', ["unknown key heading", "heading_deg"]),
        (GOOD + "[[item]]\n" + EXCITE + "repeats = 1.5", ["item 2", "repeats", "whole number"]),
        (GOOD + "[[item]]\n" + EXCITE + "repeats = 0", ["item 2", "repeats", "1 to 100"]),
        (GOOD + "[[item]]\n" + EXCITE.replace("elevator", "wing") + "repeats = 1", ["item 2", "channel", "rudder"]),
        ("item = 3", ["[[item]]"]),
        ("", ["1 to 500"]),
        (GOOD + "speed = 3\n", ["item 1", "unknown key speed"]),
        ("[wind]\n" + GOOD, ["unknown key wind"]),
        ("[[item", ["not valid TOML"]),
    ],
)  # fmt: skip
def test_a_bad_mission_is_refused_in_one_line(tmp_path: Path, text: str, reports: list[str]) -> None:
    with pytest.raises(InputError) as refusal:
        load_mission(written(tmp_path, text))
    line = str(refusal.value)
    assert "\n" not in line.strip()
    for words in reports:
        assert words in line


def test_an_unknown_mission_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match="circuit"):
        load_mission("nowhere")


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mission.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="cannot read"):
        load_mission(path)


@pytest.mark.parametrize(
    ("item", "reports"),
    [
        (MissionItem(ItemKind.WAYPOINT, north=math.nan), "item 1: WAYPOINT"),
        (MissionItem(ItemKind.EXCITE), "item 1: EXCITE"),
        (MissionItem(ItemKind.EXCITE, excitation=Excitation(Channel.ELEVATOR, Shape.DOUBLET, 3.0, 0.2, 1, 1)), "45"),
        (
            MissionItem(ItemKind.EXCITE, excitation=Excitation(Channel.ELEVATOR, Shape.DOUBLET, 0.1, 0.0, 1, 1)),
            "width",
        ),
    ],
)
def test_a_bad_mission_over_the_link_is_refused_too(item: MissionItem, reports: str) -> None:
    assert reports in check_mission((item,))


SWEEP = (
    'kind = "excite"\nchannel = "elevator"\nshape = "log_sweep"\namplitude_deg = 3\nstart = 0.5\nend = 3\n'
    "duration = 15\nsettle = 1\nrepeats = 1\n"
)
MULTISINE = 'kind = "excite"\nshape = "multisine"\nperiod = 10\nlow = 0.3\nhigh = 2.6\nsettle = 1\nrepeats = 1\n'


def test_sweeps_and_multisines_of_a_file(tmp_path: Path) -> None:
    text = f'[[item]]\n{SWEEP}loops = "active"\n[[item]]\n{MULTISINE}throttle = 0.1\nrudder_deg = 6\n'
    sweep, multisine = (item.excitation for item in load_mission(written(tmp_path, text)))
    three = math.radians(3)
    assert sweep == Excitation(Channel.ELEVATOR, Shape.LOGARITHMIC_SWEEP, three, 15.0, 1.0, 1, 0.5, 3.0, loops=1)
    assert multisine is not None
    assert multisine.amplitudes() == (0.0, 0.1, math.radians(6))
    assert (multisine.channel, multisine.width, multisine.loops) == (Channel.THROTTLE, 10.0, 0)


@pytest.mark.parametrize(
    ("item", "reports"),
    [
        (SWEEP.replace("start = 0.5", ""), "start is missing"),
        (SWEEP.replace("end = 3", "end = 30"), "end = 30"),
        (SWEEP + "width = 1", "unknown key width"),
        (SWEEP + 'loops = "open"', "loops"),
        (MULTISINE, "elevator_deg, throttle, rudder_deg"),
        (MULTISINE + "elevator_deg = 90", "elevator_deg = 90"),
        (MULTISINE.replace("high = 2.6", "high = 0.5") + "elevator_deg = 3\nrudder_deg = 3", "3 harmonics"),
        (MULTISINE.replace("high = 2.6", "high = 9") + "elevator_deg = 3", "88 harmonics"),
        (MULTISINE + 'channel = "elevator"', "unknown key channel"),
    ],
)
def test_an_input_that_cannot_be_flown_is_refused_in_one_line(tmp_path: Path, item: str, reports: str) -> None:
    with pytest.raises(InputError) as refusal:
        load_mission(written(tmp_path, "[[item]]\n" + item))
    assert reports in str(refusal.value)
    assert "item 1" in str(refusal.value)


# --- circles, surveys, jumps, fences, rally points ---------------------------------------------------------------

AROUND = """
[[item]]
kind = "takeoff"
altitude = 30
[[item]]
kind = "survey"
polygon = [[0, 50], [100, 50], [100, 110], [0, 110]]
spacing = 20
heading_deg = 0
altitude = 35
overshoot = 15
[[item]]
kind = "circle"
north = 50
east = 0
altitude = 50
turns = 1.5
radius = -35
[[item]]
kind = "jump"
item = 2
repeats = 1
[[item]]
kind = "loiter"
north = 0
east = 0
altitude = 30
[fence]
min_altitude = 8
max_altitude = 90
[[fence.zone]]
north = 0
east = 0
radius = 300
[[fence.zone]]
keep = "out"
polygon = [[200, 0], [220, 0], [220, 30]]
[[rally]]
north = 80
east = -40
altitude = 35
"""


def test_a_survey_becomes_its_waypoints_and_a_jump_finds_its_first(tmp_path: Path) -> None:
    plan = load_plan(written(tmp_path, AROUND))
    kinds = [item.kind.name for item in plan.mission]
    assert kinds == ["TAKEOFF", *["WAYPOINT"] * 6, "CIRCLE", "JUMP", "LOITER"]
    assert [(round(item.north), round(item.east)) for item in plan.mission[1:5]] == [
        (-15, 60), (115, 60), (115, 80), (-15, 80),
    ]  # fmt: skip
    circle, jump = plan.mission[7], plan.mission[8]
    assert (circle.turns, circle.radius, circle.duration) == (1.5, -35.0, 0.0)
    assert (jump.jump_to, jump.repeats) == (1, 1)


def test_fence_and_rally_points_of_a_file(tmp_path: Path) -> None:
    plan = load_plan(written(tmp_path, AROUND))
    assert (plan.fence.floor, plan.fence.ceiling) == (8.0, 90.0)
    assert [(zone.keep_in, zone.radius, len(zone.places)) for zone in plan.fence.zones] == [
        (1, 300.0, 1),
        (0, 0.0, 3),
    ]
    assert plan.rally == ((80.0, -40.0, 35.0),)


@pytest.mark.parametrize(
    ("before", "after", "reports"),
    [
        (
            "turns = 1.5",
            "turns = -1",
            "item 3: turns = -1 is outside 0 to 1000",
        ),
        ("turns = 1.5", "turns = 1\nduration = 5", "item 3: turns and duration exclude each other"),
        ("radius = -35", "radius = 1", "radius = 1 is smaller than 3 m"),
        ("radius = -35", "radius = 900", "radius = 900 is outside -500 to 500 m"),
        ("item = 2", "item = 9", "item 4: item = 9 is outside 1 to 5"),
        ("repeats = 1", "repeats = 1.5", "item 4: repeats must be a whole number"),
        ("[100, 50], [100, 110], [0, 110]]", "[100, 50]]", "item 2: polygon must be a list of 3 to 70 corners"),
        ("[100, 110]", '[100, "x"]', "item 2: polygon must be a list"),
        ("spacing = 20", "spacing = 0", "item 2: spacing = 0 is outside 1 to 1000 m"),
        ("spacing = 20", "spacing = 1\ngap = 3", "item 2: unknown key gap"),
        ("[0, 110]]", "[0, 9000]]", "item 2: a survey has 1 to 250 legs, not 448: change its spacing"),
        ("max_altitude = 90", "max_altitude = 8", "fence, max_altitude must be above min_altitude"),
        ("max_altitude = 90", "top = 8", "fence: unknown key top"),
        ("radius = 300", "radius = 3", "fence, zone 1: radius = 3 is outside 10 to 100000 m"),
        ("north = 0\neast = 0\nradius = 300", "north = 900\neast = 0\nradius = 300", "zone 1: home is outside of it"),
        ('keep = "out"', 'keep = "near"', 'fence, zone 2: keep is "near"; it must be one of in, out'),
        ("[[200, 0], [220, 0], [220, 30]]", "[[-20, -9], [22, -9], [2, 30]]", "fence, zone 2: home is in it"),
        (
            "east = -40\naltitude = 35",
            "east = -40",
            "rally 1: altitude is missing (1 to 1000 m)",
        ),
    ],
)
def test_what_is_wrong_with_it_is_said_in_one_line(tmp_path: Path, before: str, after: str, reports: str) -> None:
    assert before in AROUND
    path = written(tmp_path, AROUND.replace(before, after))
    with pytest.raises(InputError) as refusal:
        load_plan(path)
    assert reports in str(refusal.value) and "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("mission", "reports"),
    [
        ((MissionItem(ItemKind.JUMP, jump_to=3, repeats=1),), "item 1: JUMP leads to item 4 of 1"),
        ((MissionItem(ItemKind.JUMP, repeats=-2),), "repeats must be -1"),
        ((MissionItem(ItemKind.CIRCLE, altitude=40.0, radius=math.inf),), "item 1: CIRCLE: a value is not a number"),
        ((MissionItem(ItemKind.WAYPOINT, altitude=0.0),), "altitude = 0 is outside 1 to 1000 m"),
        ((MissionItem(ItemKind.WAYPOINT, north=2e4, altitude=40.0),), "north = 20000 is outside -10000 to 10000 m"),
    ],
)
def test_the_same_holds_over_the_link(mission: tuple[MissionItem, ...], reports: str) -> None:
    assert reports in check_mission(mission)
