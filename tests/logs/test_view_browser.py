"""The page in a headless Chromium: nothing goes wrong, nothing leaves the machine, everything moves together."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from browser import Browser, find_browser, opened
from circling import ONBOARD, messages
from test_view_data import simulate

from avionics import topics
from logs.reader import open_log
from logs.view.page import write_page
from wingbeat.topic import Topic

PROGRAM = find_browser()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH, and WINGBEAT_CHROMIUM names none")
EVENTS = ((1.0, "armed"), (2.0, "launched"), (15.0, "waypoint 0 reached (takeoff 14 m)"))
# Pixels of a canvas in how many colours, and a number that changes with them.
PAINTED = """(canvas => {
    const data = new Uint32Array(canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data.buffer);
    return [new Set(data).size, data.reduce((sum, pixel, n) => (sum * 31 + pixel + n) | 0, 0)];
})"""

FRAMES = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done())))"


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    assert PROGRAM is not None
    with opened(PROGRAM, tmp_path_factory.mktemp("profile")) as browser:
        yield browser


def written(folder: Path, chosen: tuple[Topic, ...] = ()) -> Path:
    """The page of a flight of 20 s of the chosen topics (all by default)."""
    path = simulate(folder / "a.mcap", messages(20.0, chosen) if chosen else messages(20.0), EVENTS)
    with open_log(path) as log:
        return write_page(log, folder / "a.html").path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a flight of every topic; none who opens it changes the file."""
    return written(tmp_path_factory.mktemp("whole"))


def shown(browser: Browser, page: Path, width: int = 1400) -> Browser:
    """A page, open in a window so wide."""
    browser.observed.clear()
    browser.send_request(
        "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
    )
    browser.open(page)
    return browser


def error_lines(browser: Browser) -> list[Any]:
    return browser.events("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")


def painted(browser: Browser, where: str) -> tuple[int, int]:
    colors, digest = browser.value(f"{PAINTED}(document.querySelector({where!r}))")
    return colors, digest


def mouse(browser: Browser, kind: str, x: float, y: float, **more: Any) -> None:
    browser.send_request("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


def place_of(browser: Browser, where: str) -> tuple[float, float, float, float]:
    """Left, top, width and height in the window."""
    box = browser.value(f"document.querySelector({where!r}).getBoundingClientRect().toJSON()")
    return box["x"], box["y"], box["width"], box["height"]


def test_nothing_goes_wrong_and_nothing_is_asked_of_a_network(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    browser.value("page.play(true)")
    browser.value(FRAMES)
    browser.value("page.play(false)")
    assert error_lines(browser) == []
    asked = [request["request"]["url"] for request in browser.events("Network.requestWillBeSent")]
    assert asked == [whole.resolve().as_uri()]


def test_everything_is_painted(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    assert painted(browser, "#scene")[0] > 50
    count = browser.value("document.querySelectorAll('#panels canvas').length")
    assert count == 10
    for n in range(1, count + 1):
        assert painted(browser, f"#panels > div:nth-child({n}) canvas")[0] > 5
    assert painted(browser, "#bands")[0] > 5


def test_the_slider_moves_the_cursor_the_bird_and_the_readings(browser: Browser, whole: Path) -> None:
    shown(browser, whole)

    def slid(time: float) -> tuple[Any, ...]:
        browser.value(f"Object.assign(document.querySelector('#slider'), {{ value: {time} }})")
        browser.value("document.querySelector('#slider').dispatchEvent(new Event('input'))")
        read = browser.value("['#clock', '#reading', '#panels'].map(of => document.querySelector(of).textContent)")
        return place_of(browser, "#cursor")[0], painted(browser, "#scene")[1], *read

    before, after = slid(5.0), slid(12.06)
    assert after[0] > before[0] + 100.0
    assert all(a != b for a, b in zip(before, after, strict=True))
    assert after[2].startswith("00:12.1") and "up 7.5 m from the ground" in after[3]
    wing = browser.value("page.scene.pose.flap[0]")
    assert wing == pytest.approx(0.6 * 0.998, abs=0.01)  # an upward stroke's end


def test_the_page_opens_at_the_start_of_the_flight(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    assert browser.value("page.time") == browser.value("page.flight.start")


def test_strokes_too_many_to_be_told_apart_are_a_shade_with_their_mean(browser: Browser, whole: Path) -> None:
    """A stroke of ±40 at 4 Hz about 10, 100 s of it on 500 px; zoomed in it is a line again."""
    shown(browser, whole)
    values = "Float32Array.from(time, (t) => 10 + 40 * Math.sin(8 * Math.PI * t))"
    made = f"const time = Float64Array.from({{ length: 20000 }}, (_, n) => 0.005 * n), low = {values};"
    observed = f"""(([from, to]) => {{ {made} const line = {{ levels: levels(time, low, low) }};
        const rows = visible(line, [from, to], 500), smooth = running(rows, 0.5);
        return [tallShare(rows, {{ y: (v) => 100 - v }}, 15), ...smooth.slice(2, -2)]; }})"""
    share, *means = browser.value(f"{observed}([0, 100])")
    assert share > 0.9 and means == pytest.approx([10.0] * len(means), abs=6.0)
    assert browser.value(f"{observed}([50, 51])")[0] == 0.0


def test_playing_goes_as_fast_as_chosen_and_ends_with_the_flight(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    frames = "page.playing = true; page.last = null; page.frame(1000); page.frame(1200);"
    browser.value(f"document.querySelector('#speed').value = '2'; page.go(5.0); {frames} page.playing = false;")
    assert browser.value("page.time") == pytest.approx(5.4)
    browser.value(f"page.go(19.9); {frames}")
    assert browser.value("[page.time, page.playing]") == [pytest.approx(20.0), False]


def test_events_are_listed_and_can_be_gone_to(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    listed = browser.value("[...document.querySelectorAll('#events li')].map(entry => entry.textContent)")
    assert listed == ["00:01.0armed", "00:02.0launched", "00:15.0waypoint 0 reached (takeoff 14 m)"]
    browser.value("document.querySelectorAll('#events button')[2].click()")
    assert browser.value("page.time") == pytest.approx(15.0)
    assert browser.value("document.querySelector('#events .now').textContent") == listed[2]


def test_a_mark_of_an_event_says_what_it_is(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    left, top, *_ = place_of(browser, "#bands")
    mouse(browser, "mouseMoved", left + browser.value("page.plots.x(15.0)"), top + 46.0)
    assert (
        "waypoint 0 reached (takeoff 14 m)" in browser.value("tip.textContent")
        and browser.value("tip.hidden") is False
    )


def test_a_drag_zooms_a_wheel_zooms_and_a_double_click_shows_all(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    whole = browser.value("page.plots.window")
    left, top, width, height = place_of(browser, "#panels > div:nth-child(4) canvas")
    y = top + 0.5 * height
    mouse(browser, "mousePressed", left + 0.4 * width, y, button="left", clickCount=1)
    mouse(browser, "mouseMoved", left + 0.6 * width, y, button="left", buttons=1)
    mouse(browser, "mouseReleased", left + 0.6 * width, y, button="left", clickCount=1)
    dragged = browser.value("page.plots.window")
    assert whole[0] < dragged[0] < dragged[1] < whole[1] and dragged[1] - dragged[0] < 0.3 * (whole[1] - whole[0])
    mouse(browser, "mouseWheel", left + 0.5 * width, y, deltaX=0, deltaY=-200)
    browser.value(FRAMES)
    wheeled = browser.value("page.plots.window")
    assert wheeled[1] - wheeled[0] < 0.9 * (dragged[1] - dragged[0])
    browser.value("document.querySelector('#panels').dispatchEvent(new MouseEvent('dblclick', { bubbles: true }))")
    assert browser.value("page.plots.window") == pytest.approx(whole)


def test_cameras_and_the_mouse_look_at_the_bird_from_elsewhere(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    views = {"follow": painted(browser, "#scene")[1]}
    for camera in ("chase", "overview"):
        browser.value(f"document.querySelector('#{camera}').click()")
        views[camera] = painted(browser, "#scene")[1]
    assert "times its size" in browser.value("legend.textContent")
    left, top, width, height = place_of(browser, "#scene")
    mouse(browser, "mousePressed", left + 0.5 * width, top + 0.6 * height, button="left", clickCount=1)
    mouse(browser, "mouseMoved", left + 0.7 * width, top + 0.6 * height, button="left", buttons=1)
    mouse(browser, "mouseReleased", left + 0.7 * width, top + 0.6 * height, button="left", clickCount=1)
    views["orbited"] = painted(browser, "#scene")[1]
    assert len(set(views.values())) == 4


@pytest.mark.parametrize("width", [1400, 1000, 420])
def test_nothing_sticks_out_of_the_window(browser: Browser, whole: Path, width: int) -> None:
    shown(browser, whole, width=width)
    assert browser.value("document.documentElement.scrollWidth <= window.innerWidth")
    outside = "[...document.querySelectorAll('canvas, button, h1, p, #events')]"
    outside += ".filter(one => one.getBoundingClientRect().right > window.innerWidth + 1).length"
    assert browser.value(outside) == 0


def test_dark_and_light_are_the_systems(browser: Browser, whole: Path) -> None:
    shown(browser, whole)
    corners = []
    for scheme in ("light", "dark"):
        browser.send_request(
            "Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}]
        )
        browser.value(FRAMES)
        corners.append(browser.value("scene.getContext('2d').getImageData(2, scene.height >> 1, 1, 1).data[0]"))
    browser.send_request("Emulation.setEmulatedMedia", features=[])
    assert corners[0] > 150 > corners[1]


def test_a_log_without_truth_and_wings_is_shown_and_says_so(browser: Browser, tmp_path: Path) -> None:
    shown(browser, written(tmp_path, tuple(topic for topic in ONBOARD if topic not in (topics.WING, topics.FLAP))))
    assert error_lines(browser) == [] and painted(browser, "#scene")[0] > 50
    words = browser.value("missing.textContent")
    assert "truth" in words and "wing angles" in words
    titles = browser.value("[...document.querySelectorAll('.title b')].map(title => title.textContent)")
    assert "Altitude above the place of boot [m]" in titles and not any("Wing" in title for title in titles)


def test_a_log_without_an_attitude_has_plots_alone(browser: Browser, tmp_path: Path) -> None:
    shown(browser, written(tmp_path, (topics.ALTITUDE, topics.POWER)))
    assert error_lines(browser) == []
    assert browser.value("space.hidden") is True
    assert browser.value("document.querySelectorAll('#panels canvas').length") == 4
