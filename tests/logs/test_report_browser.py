"""The page of an identification in a headless Chromium: nothing clipped or overlapping, nothing from a network."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, find_browser, opened

from groundstation.command import identify
from logs.identification.report.document import MEASURED, POINTS, Chapter, Plot, Series, Table
from logs.identification.report.fits import (
    correlation_chapter,
    fits_chapter,
    parameters_chapter,
    residuals_chapter,
    validation_chapter,
)
from logs.identification.report.html import page
from logs.identification.results import EstimationResult, FitSeries, Fitted, estimate, from_fitted

PROGRAM = find_browser()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium on the PATH, and WINGBEAT_CHROMIUM names none")
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
NAMES = ("X_u", "Z_delta", "M_q", "tail_time_constant", "short_period_frequency")


def fit() -> EstimationResult:
    """A method's result with numbers of every size."""
    rng = np.random.default_rng(1)
    series = []
    for i in range(4):
        time = np.arange(125) * 0.02
        for output, unit, size in (("q", "rad/s", 1e-4), ("a_x", "m/s^2", 30.0), ("a_z", "m/s^2", 12345.0)):
            model = size * np.sin(3 * time)
            measured = model + 0.1 * size * rng.normal(size=125)
            series.append(FitSeries(f"manoeuvre {i} at {20 * i}.0 s", output, unit, time, measured, model, i == 3))
    sizes = (-1.5e-5, 123456.0, -0.7, 0.03, 9.9)
    found = tuple(estimate(n, "1/s", v, 0.2 * abs(v)) for n, v in zip(NAMES, sizes, strict=True))
    factor = rng.normal(size=(5, 5))
    spread = factor @ factor.T
    scale = np.sqrt(np.diag(spread))
    correlation = spread / np.outer(scale, scale)
    fitted = Fitted("output error", ("du/dt = X_u u",), found, (), correlation, tuple(series), ("Held.",))
    return from_fitted(fitted, "output_error")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    fits, rng = (fit(),), np.random.default_rng(2)
    makers = (correlation_chapter, fits_chapter, residuals_chapter, validation_chapter)
    made = [chapter for make in makers if (chapter := make(fits)) is not None]
    assert len(made) == len(makers)
    cloud = Series("measured", rng.normal(size=9000), rng.normal(size=9000) * 1e-3, MEASURED, POINTS)
    scatter = Plot("Power against current", "current", "A", "power", "W", (cloud,))
    table = Table(("file", "number"), (("a" * 64, 1.5),), "A long word in a table.")
    known = parameters_chapter(fits, {"M_q": -0.9, "X_u": -1.4e-5})
    chapters = (known, *made, Chapter("Scatter", ("One.",), (table,), (scatter, scatter, scatter)))
    path = tmp_path_factory.mktemp("report") / "bird.html"
    path.write_text(page("bird: identification", ("flight.mcap",), chapters), encoding="utf-8")
    return path


@pytest.fixture(scope="module", params=["short_period", "transport"])
def table_page(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a worked example of docs/identify_csv.md."""
    path = tmp_path_factory.mktemp("tables") / "page.html"
    table = EXAMPLES / f"{request.param}.csv"
    assert identify.run([str(table), "--map", str(table.with_suffix(".toml")), "--report", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    assert PROGRAM is not None
    with opened(PROGRAM, tmp_path_factory.mktemp("profile")) as browser:
        yield browser


OUTSIDE = """[...document.querySelectorAll('svg')].flatMap(svg => {
    const box = svg.getBoundingClientRect();
    return [...svg.querySelectorAll('text, circle, rect')].filter(one => {
        const b = one.getBoundingClientRect();
        return b.left < box.left - 1 || b.right > box.right + 1 || b.top < box.top - 1 || b.bottom > box.bottom + 1;
    }).map(one => one.textContent || one.tagName);
})"""
OVERLAPPING = """[...document.querySelectorAll('svg')].flatMap(svg => {
    const boxes = [...svg.querySelectorAll('text')].map(one => [one.textContent, one.getBoundingClientRect()]);
    return boxes.flatMap(([a, p], i) => boxes.slice(i + 1).filter(([, q]) =>
        p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 2 && q.top < p.bottom - 2
    ).map(([b]) => a + ' | ' + b));
})"""


@pytest.mark.parametrize("width", [1300, 800, 400])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_clipped_or_overlaps_at_any_width(browser: Browser, report: Path, width: int, scheme: str) -> None:
    browser.observed.clear()
    browser.send_request(
        "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
    )
    browser.send_request("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    browser.open(report)
    assert browser.events("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded") == []
    asked = [request["request"]["url"] for request in browser.events("Network.requestWillBeSent")]
    assert asked == [report.resolve().as_uri()]
    assert browser.value("document.documentElement.scrollWidth") <= width
    assert browser.value("document.querySelectorAll('svg').length") > 20
    assert browser.value(OUTSIDE) == []
    assert browser.value(OVERLAPPING) == []


@pytest.mark.parametrize("width", [1300, 400])
def test_nothing_is_clipped_on_the_page_of_a_table(browser: Browser, table_page: Path, width: int) -> None:
    browser.observed.clear()
    browser.send_request(
        "Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False
    )
    browser.open(table_page)
    assert browser.events("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded") == []
    asked = [request["request"]["url"] for request in browser.events("Network.requestWillBeSent")]
    assert asked == [table_page.resolve().as_uri()]
    assert browser.value("document.documentElement.scrollWidth") <= width
    assert browser.value("document.querySelectorAll('svg').length") > 20
    assert browser.value(OUTSIDE) == []
    assert browser.value(OVERLAPPING) == []


def test_it_prints_black_on_white(browser: Browser, report: Path) -> None:
    browser.send_request(
        "Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": "dark"}]
    )
    browser.open(report)
    assert browser.value("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    assert browser.value("getComputedStyle(document.documentElement).backgroundColor") == "rgb(255, 255, 255)"
    browser.send_request("Emulation.setEmulatedMedia", media="", features=[])
