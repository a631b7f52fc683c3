"""The flight view and what it is made of, rendered and read back."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from avionics.messages import Stage
from groundstation.link.vehicle_state import StatusLine, VehicleState
from groundstation.views import braille, wording
from groundstation.views.flight_view import FlightView, Header, bar, progress_line
from groundstation.views.history import POINTS, History, remember
from wingbeat.message import Severity

FLYING = VehicleState(
    system=1, armed=True, time=62.34, roll=0.1, pitch=0.2, yaw=1.6, airspeed=6.8, groundspeed=7.0, altitude=40.2,
    climb_rate=0.1, throttle=0.62, north=30.0, east=40.0, satellites=9, voltage=7.9, current=1.8, power=14.2,
    battery_remaining=0.92, flap_frequency=3.62, flap_amplitude=0.6, stage=Stage.EN_ROUTE, item=2, distance=33.0,
    altitude_setpoint=40.0, heading_setpoint=1.57, exciting=True,
    events=(StatusLine(22.3, Severity.WARNING, "link [bold]lost"),),
)  # fmt: skip
HISTORY = History(tuple((t * 0.2, 40 - t * 0.1) for t in range(300)), tuple((0.3 * t, 0.1 * t) for t in range(300)))


def rendered(state: VehicleState, history: History | None, width: int, note: str = "", height: int = 24) -> list[str]:
    console = Console(width=width, height=height, record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    console.print(FlightView(Header("robo_raven_ii_d", "AUTO", note), state, history))
    return console.export_text().splitlines()


def test_everything_a_pilot_asks_for_is_there() -> None:
    text = "\n".join(rendered(FLYING, HISTORY, 100))
    for part in (
        "AUTO", "en route", "01:02.3", "40.2 m", "→ 40 m", "+0.1 m/s", "6.8 m/s", "+6°", "+11°", "092°", "3.62 Hz",
        "±34°", "62 %", "14.2 W", "7.90 V 1.80 A", "92 %", "excitation", "9 satellites", "link [bold]lost", "⌂",
    ):  # fmt: skip
        assert part in text


@pytest.mark.parametrize("width", [30, 50, 60, 80, 100, 200])
@pytest.mark.parametrize("state", [VehicleState(), FLYING])
def test_no_line_is_wider_than_the_terminal(width: int, state: VehicleState) -> None:
    lines = rendered(state, HISTORY, width)
    assert max(len(line) for line in lines) <= width


@pytest.mark.parametrize(("width", "height"), [(80, 24), (120, 40), (200, 60)])
def test_the_view_fills_the_terminal(width: int, height: int) -> None:
    """GIVEN many messages WHEN a terminal of any size shows the flight THEN every line but the cursor's is used."""
    state = FLYING._replace(events=tuple(StatusLine(float(n), Severity.INFO, f"event {n}") for n in range(40)))
    lines = rendered(state, HISTORY, width, height=height)
    assert len(lines) == height - 1
    assert max(len(line) for line in lines) == width
    plots = [line for line in lines if "│" in line]
    assert len(plots) >= 0.3 * height and min(len(line.rstrip()) for line in plots) > 0.4 * width


def test_without_data_there_are_dashes_and_no_zeros() -> None:
    lines = rendered(VehicleState(), History(), 100, "waiting for a vehicle")
    numbers = "\n".join(lines[1:6])
    assert numbers.count("–") == 12
    assert "0" not in numbers


def test_values_that_are_not_finite_are_dashes() -> None:
    broken = VehicleState(
        altitude=math.nan, yaw=math.inf, roll=math.nan, throttle=math.nan, airspeed=math.inf, time=math.nan
    )
    text = "\n".join(rendered(broken, History(), 100))
    assert "nan" not in text and "inf" not in text


def test_the_layout_does_not_jump_between_two_pictures() -> None:
    later = FLYING._replace(altitude=-3.1, airspeed=12.0, yaw=0.0, power=104.0, throttle=1.0)
    first, second = rendered(FLYING, HISTORY, 100), rendered(later, HISTORY, 100)
    for one, other in zip(first[2:6], second[2:6], strict=True):
        for label in ("roll", "pitch", "heading", "flapping", "throttle", "power", "battery"):
            assert one.find(label) == other.find(label)


def test_progress_line() -> None:
    assert progress_line(FLYING, "AUTO") == (
        "  62.3 s  AUTO          en route    altitude  40.2 m  airspeed  6.8 m/s  heading 092°  flapping 3.62 Hz"
        "  power 14.2 W  waypoint 2"
    )
    assert "altitude –" in progress_line(VehicleState(), "")


def test_a_rising_line_rises_in_braille() -> None:
    picture = braille.draw([[(0.0, 0.0), (1.0, 1.0)]], braille.Window(0, 1, 0, 1), 4, 2)
    assert len(picture) == 2 and all(len(row) == 4 for row in picture)
    assert picture[0][0] == chr(0x2800) and picture[1][0] != chr(0x2800)
    assert picture[0][3] != chr(0x2800) and picture[1][3] == chr(0x2800)


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=20))
def test_any_points_fit_the_plot(points: list[tuple[float, float]]) -> None:
    picture = braille.draw([points], braille.Window(-1, 1, -1, 1), 10, 3)
    assert [len(row) for row in picture] == [10, 10, 10]


def test_a_line_through_the_window_is_seen_from_however_far_it_comes() -> None:
    window = braille.Window(-1, 1, -1, 1)
    near = braille.draw([[(-1.0, -1.0), (1.0, 1.0)]], window, 10, 3)
    far = braille.draw([[(-1e9, -1e9), (1e9, 1e9)]], window, 10, 3)
    assert near == far
    assert braille.draw([[(-1e9, 5.0), (1e9, 5.0)]], window, 2, 1) == [chr(0x2800) * 2]


@given(st.floats(1e-6, 1e6))
def test_an_axis_ends_at_a_round_number_just_above(value: float) -> None:
    end = braille.round_up(value)
    assert value * (1 - 1e-6) <= end <= 2.5 * value * (1 + 1e-6)
    mantissa = end / 10 ** math.floor(math.log10(end) + 1e-9)
    assert min(abs(mantissa - digit) for digit in (1, 2, 5, 10)) < 1e-6


def test_history_is_bounded_and_keeps_the_whole_flight() -> None:
    history = History()
    for step in range(20000):
        state = VehicleState(time=step * 0.1, altitude=float(step), north=0.0, east=float(step))
        history = remember(history, state)
    assert len(history.altitude) <= POINTS and len(history.track) == len(history.altitude)
    assert history.altitude[0] == (0.0, 0.0) and history.altitude[-1][0] > 1980.0


def test_history_leaves_out_what_is_not_a_number() -> None:
    assert remember(History(), VehicleState(time=1.0, altitude=math.nan)) == History()
    there = VehicleState(time=1.0, altitude=2.0, north=math.nan, east=1.0)
    assert remember(History(), there).track == ()


def test_history_starts_anew_with_the_vehicle() -> None:
    history = remember(History(), VehicleState(time=100.0, altitude=5.0))
    assert remember(history, VehicleState(time=1.0, altitude=0.0)).altitude == ((1.0, 0.0),)


@pytest.mark.parametrize(
    ("share", "text"), [(None, ""), (math.nan, ""), (0.0, "╌╌╌╌"), (0.5, "━━╌╌"), (1.7, "━━━━"), (-1.0, "╌╌╌╌")]
)
def test_bar(share: float | None, text: str) -> None:
    assert bar(share, 4) == text


@pytest.mark.parametrize(
    ("angle", "text"), [(0.0, "000°"), (-0.001, "000°"), (math.pi, "180°"), (-math.pi / 2, "270°"), (None, "–")]
)
def test_bearing(angle: float | None, text: str) -> None:
    assert wording.bearing(angle) == text


@pytest.mark.parametrize(
    ("value", "error", "texts"),
    [
        (5.43219, 0.123, ("5.43", "0.12")),
        (1234.5, 45.0, ("1234", "45")),
        (0.00123456, 0.0000123, ("0.001235", "0.000012")),
        (1.5, math.nan, ("1.5", "–")),
    ],
)
def test_two_digits_of_the_uncertainty(value: float, error: float, texts: tuple[str, str]) -> None:
    assert wording.significant(value, error) == texts


@pytest.mark.parametrize(("seconds", "text"), [(0.84, "0.8 s"), (12.4, "12 s"), (185.0, "3 min 05 s")])
def test_duration(seconds: float, text: str) -> None:
    assert wording.duration(seconds) == text


def test_nothing_is_minus_zero() -> None:
    still = VehicleState(time=1.0, roll=-0.001, pitch=-0.0, altitude=-0.01, climb_rate=-0.02)
    text = "\n".join(rendered(still, History(((0.0, -0.2), (1.0, -0.01))), 100))
    assert "-0 m" not in text and "-0°" not in text and "-0.0 m" not in text
