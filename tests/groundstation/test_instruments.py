"""The monitor's views: pure functions, rendered with and without data."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from rich.console import Console, RenderableType
from rich.text import Text

from avionics.link.dialect import mavlink
from avionics.messages import Stage
from groundstation.link.missions import Item
from groundstation.link.station import Note, Picture
from groundstation.link.traffic import MessageRow, Quality
from groundstation.link.vehicle_state import StatusLine, VehicleState
from groundstation.screen.panel import View
from groundstation.views import inspector, panels
from groundstation.views.field_plot import Trace, field_plot
from groundstation.views.horizon import GROUND, SKY, horizon
from groundstation.views.tape import AIRSPEED, ALTITUDE, BUG, WINDOW, tape
from wingbeat.message import Severity

STATE = VehicleState(
    system=1, autopilot=0, vehicle_type=16, custom_mode=4 << 16 | 4 << 24, armed=True, time=83.4, received_at=10.0,
    roll=0.1, pitch=0.2, yaw=1.0, airspeed=7.5, altitude=40.2, climb_rate=0.6, throttle=0.5, voltage=7.9, current=2.0,
    power=15.8, energy=3600.0, battery_remaining=0.18, flap_frequency=4.2, flap_left=0.4, flap_right=0.4,
    flap_phase=math.pi / 2, flap_amplitude=0.5, stage=Stage.EN_ROUTE, item=1, items=3, distance=55.0, north=30.0,
    east=40.0, fix_type=3, satellites=9, events=(StatusLine(80.0, Severity.CRITICAL, "battery low"),),
)  # fmt: skip
MISSION = tuple(Item(3, 16, (0.0,) * 4, 10 * n, 10, 30.0 + n) for n in range(3))
PICTURE = Picture(
    "udpin:test",
    STATE,
    Quality(80.0, 3100.0, 0.12, 7, 1, 500, 0.012),
    0.1,
    MISSION,
    (Note(81.0, "armed"),),
    "",
    Path("a.mcap"),
)
VIEWS = (panels.flapping, panels.power, panels.mission, panels.link, panels.sayings)


def drawn(renderable: RenderableType, width: int = 60) -> list[str]:
    console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: PTH123, SIM115
    console.print(renderable)
    return [line.rstrip() for line in console.export_text().rstrip("\n").split("\n")]


def colors(text: Text, columns: int) -> list[list[tuple[int, int, int] | None]]:
    """Background colour of every cell."""
    console = Console(width=columns, color_system="truecolor", force_terminal=True)
    rows = console.render_lines(text, console.options.update(width=columns), pad=False)
    cells = []
    for row in rows:
        line: list[tuple[int, int, int] | None] = []
        for segment in row:
            paper = segment.style.bgcolor if segment.style else None
            line += [tuple(paper.triplet) if paper is not None and paper.triplet else None] * len(segment.text)  # type: ignore[list-item]
        cells.append(line)
    return cells


@pytest.mark.parametrize(("columns", "adjacent"), [(24, "mean"), (32, "mean  0.35 Wh"), (44, "mean  0.35 Wh drawn")])
def test_the_power_says_that_it_is_a_mean_and_is_not_cut(columns: int, adjacent: str) -> None:
    state = VehicleState(voltage=8.0, current=4.0, power=32.0, energy=1260.0, mean_supply=True)
    lines = drawn(panels.power(Picture(state=state), columns, 3), columns)
    assert lines[2].split(maxsplit=1)[1].strip() == f"32.0 W  {adjacent}"
    assert "8.00 V  4.00 A" in lines[1] and not any("…" in line for line in lines)


def test_the_power_of_a_moment_is_not_called_a_mean() -> None:
    state = VehicleState(voltage=8.0, current=4.0, power=32.0, energy=1260.0)
    lines = drawn(panels.power(Picture(state=state), 44, 3), 44)
    assert lines[2].split(maxsplit=1)[1].strip() == "32.0 W  0.35 Wh drawn"


# --- the horizon ----------------------------------------------------------------------------------------


def share_of_sky(roll: float, pitch: float, left: int = 0, right: int = 60) -> float:
    cells = [cell for row in colors(horizon(roll, pitch, 60, 20), 60) for cell in row[left:right]]
    return sum(cell in SKY for cell in cells) / len(cells)


def test_level_flight_is_half_sky_above_half_ground() -> None:
    rows = colors(horizon(0.0, 0.0, 60, 20), 60)
    assert all(cell in SKY for row in rows[:10] for cell in row)
    assert all(cell in GROUND for row in rows[10:] for cell in row)


def test_the_nose_up_shows_more_sky() -> None:
    shares = [share_of_sky(0.0, math.radians(angle)) for angle in (-20, -10, 0, 10, 20)]
    assert shares == sorted(shares) and shares[0] < 0.2 < 0.8 < shares[-1]


def test_the_right_wing_down_lifts_the_ground_on_the_right() -> None:
    assert share_of_sky(0.4, 0.0, right=15) > 0.7 > 0.3 > share_of_sky(0.4, 0.0, left=45)
    assert share_of_sky(-0.4, 0.0, right=15) < 0.3 < 0.7 < share_of_sky(-0.4, 0.0, left=45)


def test_upside_down_the_ground_is_above() -> None:
    rows = colors(horizon(math.pi, 0.0, 60, 20), 60)
    assert rows[1][0] in GROUND and rows[-1][0] in SKY


@pytest.mark.parametrize("angle", [None, math.nan])
def test_no_attitude_is_said(angle: float | None) -> None:
    assert "no attitude" in horizon(angle, 0.1, 40, 10).plain
    assert "no attitude" in horizon(0.1, angle, 40, 10).plain


@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (7, 2), (20, 5), (200, 60)])
def test_the_horizon_fills_any_room(columns: int, rows: int) -> None:
    lines = horizon(0.3, -1.2, columns, rows).plain.split("\n")
    assert len(lines) == rows and all(len(line) == columns for line in lines)


# --- tapes ----------------------------------------------------------------------------------------------


def test_the_value_stands_level_with_the_horizons_middle_between_its_neighbours() -> None:
    lines = tape(ALTITUDE, 40.2, None, 10, 21).plain.split("\n")
    assert len(lines) == 21 and lines[10].split() == ["40.2"]
    numbers = [(row, int(line.split()[0])) for row, line in enumerate(lines[2:], 2) if line.strip(" ┤╷◀").isdigit()]
    assert all(40 + 10 - row == number for row, number in numbers) and len(numbers) >= 3


def test_the_bug_is_at_the_setpoint() -> None:
    text = tape(ALTITUDE, 40.0, 43.0, 10, 21)
    assert text.plain.split("\n")[7].endswith("◀")
    assert {BUG, WINDOW} <= {str(span.style) for span in text.spans}


def test_nothing_flies_slower_than_it_stands() -> None:
    numbers = [line.strip(" ┤╷") for line in tape(AIRSPEED, 0.4, None, 9, 21).plain.split("\n")[2:]]
    assert all(float(number) >= 0.0 for number in numbers if number)


def test_an_unheard_value_is_a_dash_without_a_scale() -> None:
    lines = tape(AIRSPEED, None, None, 9, 15).plain.split("\n")
    assert [line.strip() for line in lines[2:] if line.strip()] == ["–"]


# --- panels ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("picture", [Picture(), PICTURE])
@pytest.mark.parametrize(("columns", "rows"), [(12, 1), (38, 4), (60, 14)])
def test_every_panel_fits_its_room_with_and_without_data(
    view: View, picture: Picture, columns: int, rows: int
) -> None:
    lines = drawn(view(picture, columns, rows), columns)
    assert lines and all(len(line) <= columns for line in lines)


def test_the_wings_are_drawn_where_they_are() -> None:
    up, down = (panels.wings(STATE._replace(flap_left=a, flap_right=a), 30, 7).plain.split("\n") for a in (0.6, -0.6))
    inked = lambda line: any(letter not in " \u2800◆" for letter in line)  # noqa: E731
    assert inked(up[1]) and not inked(up[5]) and inked(down[5]) and not inked(down[1])


def test_the_phase_runs_from_left_to_right_and_over() -> None:
    places = []
    for degrees in (-80, 0, 90, 180, 260):
        state = STATE._replace(flap_phase=math.radians(degrees) % math.tau)
        lines = drawn(panels.flapping(Picture(state=state), 40, 3), 40)
        places.append(next(line for line in lines if "●" in line).index("●"))
    assert places == sorted(places) and len(set(places)) == 5


def test_status_says_who_what_and_how_far() -> None:
    line = panels.status_line(PICTURE, 100).plain
    assert len(line) <= 100
    for word in ("flapping wing 1", "ARMED", "AUTO", "en route", "3D fix 9 sat", "01:23.4"):
        assert word in line


def test_silence_and_a_running_order_are_said() -> None:
    assert "no telemetry for 12 s" in panels.status_line(PICTURE._replace(silence=12.3), 100).plain
    assert "arm …" in panels.status_line(PICTURE._replace(busy="arm"), 100).plain
    assert "waiting for a vehicle on tcp:x" in panels.status_line(Picture("tcp:x"), 100).plain


def test_loss_rate_latency_and_the_file_are_shown() -> None:
    text = "\n".join(drawn(panels.link(PICTURE, 50, 4), 50))
    for word in ("12.0 %", "7 of 507 lost", "3.1 kB/s", "80 messages/s", "12 ms", "a.mcap"):
        assert word in text
    assert "not recorded" in "\n".join(drawn(panels.link(PICTURE._replace(recording=None), 50, 4), 50))


@pytest.mark.parametrize("columns", [31, 60])
def test_the_numbers_of_link_and_mission_are_whole_where_the_screen_is_narrow(columns: int) -> None:
    """Given the room of a panel on a terminal of 100 columns, nothing that is said is cut off."""
    quality = Quality(188.0, 12_100.0, 0.012, 12, 0, 5186, 0.014)
    state = VehicleState(north=1500.0, east=900.0, groundspeed=12.3, item=5, items=9, heading_setpoint=2.0)
    state = state._replace(altitude_setpoint=40.0, distance=1290.0)
    picture = Picture(state=state, quality=quality)
    lines = drawn(panels.link(picture, columns, 4), columns) + drawn(panels.mission(picture, columns, 3), columns)
    text = "\n".join(lines)
    assert "…" not in text
    for word in ("1290 m to go", "12 ", " lost", "12.1 kB/s", "188 ", "/s", "1749 m", "12.3 m/s"):
        assert word in text


def test_the_mission_marks_the_item_that_is_flown() -> None:
    lines = drawn(panels.mission(PICTURE, 50, 8), 50)
    assert [line for line in lines if "▶" in line] == ["▶  1 fly to  31 m"]
    assert any("1 of 2" in line for line in lines) and any("55 m to go" in line for line in lines)
    assert any(line.split()[:3] == ["home", "50", "m"] for line in lines)


def test_sayings_are_in_the_order_of_their_times_and_the_newest_stay() -> None:
    lines = drawn(panels.sayings(PICTURE, 60, 5))
    assert [line.split()[1] for line in lines] == ["critical", "gcs"]
    many = STATE._replace(events=tuple(StatusLine(float(n), Severity.INFO, f"line {n}") for n in range(20)))
    assert [line.split()[-1] for line in drawn(panels.sayings(Picture(state=many), 60, 4))] == [
        "16",
        "17",
        "18",
        "19",
    ]


# --- plots and inspector --------------------------------------------------------------------------------


def test_a_plot_rises_with_its_field_and_says_what_it_is() -> None:
    points = [(float(n), 0.1 * n) for n in range(100)]
    lines = field_plot(Trace("ATTITUDE.pitch", "rad", points), 99.0, 60, 12).plain.split("\n")
    assert len(lines) == 12 and all(len(line) <= 60 for line in lines)
    assert "ATTITUDE.pitch" in lines[0] and "9.9 rad" in lines[0]
    inked = [
        [c for c, letter in enumerate(line.partition("│")[2]) if letter not in " \u2800"] for line in lines[1:-1]
    ]
    firsts = [row[0] for row in inked if row]
    assert firsts == sorted(firsts, reverse=True) and len(firsts) >= 8


@pytest.mark.parametrize(
    "points", [[], [(0.0, math.nan)], [(5.0, 3.0)], [(0.0, 7.0), (1.0, 7.0)], [(0.0, 1e30), (1.0, -1e30)]]
)
def test_a_plot_of_little_or_odd_data_is_drawn(points: list[tuple[float, float]]) -> None:
    lines = field_plot(Trace("A.b", "", points), 5.0, 40, 8).plain.split("\n")
    assert lines[0].strip().startswith("A.b") and len(lines) in (2, 8)


def test_fields_have_units_labels_and_elements() -> None:
    rows = {row.path: row for row in inspector.field_rows(mavlink.MAVLink_heartbeat_message(16, 0, 129, 7, 4, 3))}
    assert rows["type"].value == "16  MAV_TYPE_FLAPPING_WING" and rows["base_mode"].value == "129"
    battery = mavlink.MAVLink_battery_status_message(0, 0, 1, 32767, [8000, *[65535] * 9], 150, 0, 0, 90)
    rows = {row.path: row for row in inspector.field_rows(battery)}
    assert (rows["voltages[0]"].value, rows["voltages[0]"].unit) == ("8000", "mV")
    said = inspector.field_rows(mavlink.MAVLink_statustext_message(4, b"a\x1b[31mb"))
    assert {row.path: row.value for row in said}["text"] == "a [31mb"


def test_a_row_of_the_inspector_says_how_often_and_how_long_ago() -> None:
    cells = inspector.message_cells(MessageRow("ATTITUDE", (1, 1), 200, 10.04, 40, 0.12, None))
    assert cells == ("ATTITUDE", "1/1", "10.0 Hz", "200", "40 B", "0.1 s")
    assert inspector.message_cells(MessageRow("A", (1, 1), 1, 0.0, 40, 125.0, None))[2:] == (
        "–",
        "1",
        "40 B",
        "2 min",
    )
    assert inspector.field_rows(None) == []
