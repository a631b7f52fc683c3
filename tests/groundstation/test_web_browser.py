"""The web view in a headless Chromium: data of a vehicle on the page, a confirmed command, any width."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import pytest
from browser import Browser, find_browser, opened
from lossy_vehicle import LossyVehicle, VibratingVehicle
from test_web_view import served

from avionics.link.dialect import mavlink
from avionics.missions.reader import FOLDER as MISSIONS
from groundstation.link.waypoints import convention_of, read_upload

PROGRAM = find_browser()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH, and WINGBEAT_CHROMIUM names none")
PATIENCE = 20.0
COLORS = """(name => {
    const canvas = document.getElementById(name), pen = canvas.getContext('2d');
    return new Set(new Uint32Array(pen.getImageData(0, 0, canvas.width, canvas.height).data.buffer)).size;
})"""


class Circling(LossyVehicle):
    """Flies north at 0.2 m a message, with wings at 3 Hz, at item 1 of the mission."""

    def answers(self, message: object) -> list[object]:
        n = len(self.requests)
        flown = [
            mavlink.MAVLink_attitude_message(400 * n, 0.3, 0.1, 1.0, 0, 0, 0),
            mavlink.MAVLink_local_position_ned_message(400 * n, 0.2 * n, 5.0, -25.0, 7.0, 0.0, 0.0),
            mavlink.MAVLink_vfr_hud_message(7.5, 7.0, 60, 40, 25.0, 0.5),
            mavlink.MAVLink_wingbeat_wing_state_message(400 * n, 0.2, 0.2, 0, 0, 0.5, 3.0, 0.6, 0.6, 0.1, 0.5, n, 1),
            mavlink.MAVLink_mission_current_message(1),
            mavlink.MAVLink_statustext_message(4, b"<b>wind</b> is strong") if n == 2 else None,
        ]
        return [*super().answers(message), *(one for one in flown if one is not None)]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    assert PROGRAM is not None
    with opened(PROGRAM, tmp_path_factory.mktemp("profile")) as browser:
        yield browser


def visit(browser: Browser, url: str, width: int = 1400) -> None:
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.send_request("Emulation.setDeviceMetricsOverride", **size)
    browser.send_request("Page.navigate", url="about:blank")
    # The page before reports its lost connection until it is closed.
    until(browser, "location.href === 'about:blank' && document.readyState === 'complete'")
    browser.observed.clear()
    browser.send_request("Page.navigate", url=url)


def until(browser: Browser, expression: str) -> None:
    limit = time.monotonic() + PATIENCE
    while not browser.value(expression):
        assert time.monotonic() < limit, f"never came true: {expression}; errors: {errors(browser)}"
        time.sleep(0.05)


def errors(browser: Browser) -> list[Any]:
    return browser.events("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")


def test_page_shows_the_vehicle_and_commands_after_a_confirmation(browser: Browser) -> None:
    """GIVEN a flying vehicle WHEN Arm is clicked THEN No leaves it disarmed, Yes arms it, and the page says so."""
    vehicle = Circling()
    vehicle.mission = list(read_upload(MISSIONS / "circuit.toml", convention_of(0)).mission)
    with served(vehicle) as view:
        visit(browser, view.server.url)
        until(browser, "document.getElementById('vehicle')?.textContent === 'flapping wing 1'")
        until(browser, "document.querySelectorAll('#mission tr').length > 3")
        until(browser, "document.querySelector('#mission tr.active td')?.textContent === '1'")
        until(browser, "document.getElementById('events').textContent.includes('<b>wind</b> is strong')")
        until(browser, "document.getElementById('numbers').textContent.includes('17°')")
        until(browser, "document.querySelector('#plots output').textContent === '25'")
        for canvas in ("instruments", "wings", "track"):
            assert browser.value(f"{COLORS}({canvas!r})") > 5, canvas
        browser.value("document.querySelector('[data-order=arm]').click()")
        assert browser.value("document.getElementById('question').textContent") == "Arm?"
        browser.value("document.querySelector('dialog [value=no]').click()")
        time.sleep(0.5)
        assert not vehicle.armed
        browser.value("document.querySelector('[data-order=arm]').click()")
        browser.value("document.querySelector('dialog [value=yes]').click()")
        until(browser, "document.getElementById('armed').textContent === 'ARMED'")
        until(browser, "document.getElementById('result').textContent === 'armed'")
        browser.value(
            "document.getElementById('modes').value = 'ALTITUDE_HOLD', document.getElementById('set').click()"
        )
        browser.value("document.querySelector('dialog [value=yes]').click()")
        until(browser, "document.getElementById('mode').textContent === 'ALTITUDE HOLD'")
        assert not errors(browser)


def test_vibration_is_drawn_while_its_panel_is_open(browser: Browser) -> None:
    """GIVEN a vibrating vehicle WHEN the panel is opened THEN the page has the RMS of each axis and a plot."""
    with served(VibratingVehicle()) as view:
        visit(browser, view.server.url)
        until(browser, "document.getElementById('vehicle')?.textContent === 'flapping wing 1'")
        browser.value("document.querySelector('#vibration summary').click()")
        until(browser, "document.getElementById('spectrum').textContent.includes('z 1.4')")
        assert browser.value("document.querySelectorAll('#spectrum canvas').length") == 1
        assert browser.value("document.documentElement.scrollWidth") <= 1400
        assert not errors(browser)


@pytest.mark.parametrize("width", [1400, 800, 400])
def test_page_fits_the_width(browser: Browser, width: int) -> None:
    """GIVEN a window of this width WHEN data is shown THEN nothing is wider than the window."""
    with served(Circling()) as view:
        visit(browser, view.server.url, width)
        until(browser, "document.querySelector('#plots output')?.textContent === '25'")
        assert browser.value("document.documentElement.scrollWidth") <= width
        assert browser.value("document.getElementById('instruments').getBoundingClientRect().width") > 250
        assert not errors(browser)


def test_page_without_the_token_is_view_only(browser: Browser) -> None:
    with served(Circling()) as view:
        visit(browser, view.server.url.partition("#")[0])
        until(browser, "document.getElementById('link')?.textContent.includes('view only')")
        assert browser.value("[...document.querySelectorAll('#commands button')].every((one) => one.disabled)")


def test_page_reports_a_lost_station(browser: Browser) -> None:
    """GIVEN an open page WHEN the station ends THEN the page says so and its buttons are disabled."""
    with served(Circling()) as view:
        visit(browser, view.server.url)
        until(browser, "document.querySelector('#plots output')?.textContent === '25'")
    until(browser, "document.getElementById('link').textContent === 'ground station not reachable'")
    assert browser.value("document.querySelector('[data-order=arm]').disabled && document.body.matches('.stale')")
