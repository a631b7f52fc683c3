"""The page of an identification in a headless Chromium: nothing clipped or overlapping, nothing from a network."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from browser import Browser, find_browser, opened

from groundstation.command import identify
from logs.identification.findings import Finding
from logs.identification.report.methods import method_chapter
from logs.identification.results import EstimationResult, FitSeries, estimate
from logs.pages.document import MEASURED, POINTS, Chapter, Plot, Series, Table
from logs.pages.render import page

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
    errors = np.array([one.standard_error for one in found])
    return EstimationResult(
        "output_error", equations=("du/dt = X_u u",), estimates=found, series=tuple(series), title="output error",
        covariance=correlation * np.outer(errors, errors), findings=(Finding("note", "info", details={"note": "n"}),),
    )  # fmt: skip


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(2)
    cloud = Series("measured", rng.normal(size=9000), rng.normal(size=9000) * 1e-3, MEASURED, POINTS)
    scatter = Plot("Power against current", "current", "A", "power", "W", (cloud,))
    table = Table(("file", "number"), (("a" * 64, 1.5),), "A long word in a table.")
    known = method_chapter(fit(), {"M_q": -0.9, "X_u": -1.4e-5})
    chapters = (known, Chapter("Scatter", ("One.",), (table,), (scatter, scatter, scatter)))
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


OUTSIDE = """[...document.querySelectorAll('.uplot canvas, .bar i')].filter(one => {
    const box = one.closest('.plot, .bar').getBoundingClientRect(), b = one.getBoundingClientRect();
    return b.left < box.left - 5 || b.right > box.right + 5;
}).map(one => one.className + ' ' + one.getBoundingClientRect().width)"""
BLANK = """plots.filter(({ctx, bbox}) => {
    const {data} = ctx.getImageData(bbox.left + 2, bbox.top + 2, bbox.width - 4, bbox.height - 4);
    return !data.some(value => value);
}).length"""
COMPLETE = "plots.length === document.querySelectorAll('[data-plot]').length"


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
    assert browser.value("plots.length") > 8 and browser.value(COMPLETE)
    assert browser.value(OUTSIDE) == []
    assert browser.value(BLANK) == 0


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
    assert browser.value("plots.length") > 8 and browser.value(COMPLETE)
    assert browser.value(OUTSIDE) == []
    assert browser.value(BLANK) == 0


def test_a_plot_zooms_by_dragging_and_resets_by_a_double_click(browser: Browser, report: Path) -> None:
    browser.open(report)
    browser.value("plots[0].root.scrollIntoView({block: 'center'})")
    box = browser.value("(r => [r.left, r.top, r.width, r.height])(plots[0].over.getBoundingClientRect())")
    span, y = "plots[0].scales.x.max - plots[0].scales.x.min", box[1] + box[3] / 2
    whole = browser.value(span)
    for kind, share in (("mousePressed", 0.25), ("mouseMoved", 0.5), ("mouseReleased", 0.5)):
        browser.send_request(
            "Input.dispatchMouseEvent", type=kind, x=box[0] + share * box[2], y=y, button="left", clickCount=1
        )
    assert browser.value(span) == pytest.approx(0.25 * whole, rel=0.05)
    for _ in range(2):
        for count in (1, 2):
            for kind in ("mousePressed", "mouseReleased"):
                browser.send_request(
                    "Input.dispatchMouseEvent", type=kind, x=box[0] + 9, y=y, button="left", clickCount=count
                )
    assert browser.value(span) == pytest.approx(whole)


def test_a_hostile_log_runs_no_script_of_its_own(browser: Browser, tmp_path: Path) -> None:
    """GIVEN names that are scripts, WHEN the page is opened, THEN none runs, as text or behind the template."""
    attack = "</script><script>window.attacked = 1</script><img src=x onerror='window.attacked = 1'>"
    line = Series(attack, np.arange(9.0), np.arange(9.0), MEASURED)
    chapter = Chapter(attack, (attack,), plots=(Plot(attack, attack, "s", attack, "m", (line,)),))
    text = page(attack, (attack,), (chapter,))
    path = tmp_path / "page.html"
    # The second page has the attack as markup: only the policy is left.
    for content in (text, text.replace("</main>", f"</main>{attack}")):
        path.write_text(content, encoding="utf-8")
        browser.open(path)
        assert browser.value("plots.length") == 1 and browser.value("typeof attacked") == "undefined"


def test_the_first_chapter_fits_800_pixels(browser: Browser, table_page: Path) -> None:
    browser.send_request(
        "Emulation.setDeviceMetricsOverride", width=800, height=900, deviceScaleFactor=1, mobile=False
    )
    browser.open(table_page)
    tables = "[...document.querySelectorAll('section:first-child .scroll')]"
    assert browser.value(f"{tables}.length") > 0
    assert browser.value(f"{tables}.filter(one => one.scrollWidth > one.clientWidth).length") == 0


def test_it_prints_on_few_pages_with_the_plots(browser: Browser, table_page: Path) -> None:
    """GIVEN the report of a table WHEN it is printed on A4 THEN it has fewer than 12 pages and plots of its width."""
    browser.open(table_page)
    browser.value("addEventListener('beforeprint', () => { window.widths = plots.map(one => one.width); })")
    printed = browser.send_request("Page.printToPDF", printBackground=True, preferCSSPageSize=True)["data"]
    content = base64.b64decode(printed)
    pages = max(int(one) for one in re.findall(rb"/Count (\d+)", content))
    assert 1 < pages < 12
    assert set(browser.value("widths")) <= {703, 229} and browser.value("widths.length === plots.length")
    assert browser.value("document.documentElement.className") == ""


def test_it_prints_black_on_white(browser: Browser, report: Path) -> None:
    browser.send_request(
        "Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": "dark"}]
    )
    browser.open(report)
    assert browser.value("getComputedStyle(document.body).color") == "rgb(0, 0, 0)"
    assert browser.value("getComputedStyle(document.documentElement).backgroundColor") == "rgb(255, 255, 255)"
    browser.send_request("Emulation.setEmulatedMedia", media="", features=[])
