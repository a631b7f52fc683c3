"""Pages of HTML: escaping, content security policy, tables, intervals, data of plots."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from logs.identification.results import Estimate, estimate
from logs.pages.document import (
    DASHED,
    MEASURED,
    POINTS,
    STEMS,
    STEPS,
    Band,
    Bar,
    Chapter,
    Intervals,
    Plot,
    Remark,
    Series,
    Table,
)
from logs.pages.plots import LINE_SAMPLES, decimated, plot_data
from logs.pages.render import page, write_page
from wingbeat.errors import InputError

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>"


class Elements(HTMLParser):
    """Tags, attributes, and the text of scripts."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[str] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [name for name, _ in attrs]
        if tag == "script":
            self.scripts.append((dict(attrs), ""))
        if tag not in ("meta", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] == "script":
            kind, text = self.scripts[-1]
            self.scripts[-1] = kind, text + data


def line(y: list[float], style: str = "line", label: str = "line") -> Series:
    return Series(label, np.arange(len(y), dtype=np.float64), np.array(y), MEASURED, style)


def plot(*series: Series, bands: tuple[Band, ...] = ()) -> Plot:
    return Plot("title", "time", "s", "y", "m/s^2", series, bands)


def shown(text: str) -> list[dict[str, Any]]:
    (data,) = (code for kind, code in Elements(text).scripts if kind.get("type") == "application/json")
    found = json.loads(data)
    assert isinstance(found, list)
    return found


def test_hostile_names_are_text_wherever_they_stand() -> None:
    """GIVEN a log whose names are markup, WHEN a page shows them in every place, THEN no element is added."""
    bars = Intervals(HOSTILE, (Bar(HOSTILE, estimate(HOSTILE, HOSTILE, 1.0, 0.1), 1.0, HOSTILE),))
    picture = Plot(
        HOSTILE, HOSTILE, HOSTILE, HOSTILE, HOSTILE, (line([1.0, 2.0], label=HOSTILE),),
        (Band(HOSTILE, np.arange(2.0), np.zeros(2), np.ones(2)),), ((0.5, HOSTILE),),
    )  # fmt: skip
    table = Table((HOSTILE,), ((HOSTILE,),), HOSTILE)
    remark = Remark("warning", HOSTILE, HOSTILE, HOSTILE)
    chapter = Chapter(HOSTILE, (HOSTILE,), (table,), (bars, picture), (Chapter(HOSTILE),), (remark,))
    text = page(HOSTILE, (HOSTILE,), (chapter,))
    found = Elements(text)
    assert found.open == [] and "img" not in found.tags and "onerror" not in found.attributes
    assert len(found.scripts) == 2
    assert shown(text)[0]["series"][0]["label"] == HOSTILE


def test_only_the_scripts_of_the_package_may_run() -> None:
    """The content security policy names the hash of each script and permits nothing else."""
    text = page("t", (), (Chapter("c", plots=(plot(line([1.0, 2.0])),)),))
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    assert policy is not None
    codes = [code for kind, code in Elements(text).scripts if "type" not in kind]
    digests = [base64.b64encode(hashlib.sha256(code.encode()).digest()).decode() for code in codes]
    assert len(digests) == 1
    rule = f"default-src 'none'; script-src 'sha256-{digests[0]}'; style-src 'unsafe-inline'; img-src data:"
    assert policy[1].replace("&#39;", "'") == rule


def test_a_page_without_plots_has_no_script() -> None:
    assert "<script" not in page("t", (), (Chapter("c", ("note",)),))


def test_every_style_of_series_has_its_samples() -> None:
    nan, ends = float("nan"), np.array([0.0, 2.0])
    series = (line([1.0, nan, 3.0]), *(line([0.0, 2.0, 1.0], style) for style in (DASHED, POINTS, STEMS, STEPS)))
    text = page("t", (), (Chapter("c", plots=(plot(*series, bands=(Band("band", ends, ends - 1, ends + 1),)),)),))
    (data,) = shown(text)
    columns = data["columns"]
    assert columns[data["series"][0]["y"]] == [1.0, None, 3.0]
    assert [one["style"] for one in data["series"]] == ["line", DASHED, POINTS, STEMS, STEPS]
    (band,) = data["bands"]
    assert columns[band["high"]] == [1.0, 3.0] and columns[band["low"]] == [-1.0, 1.0]
    assert data["x"] == "time (s)" and "y (m/s²)" in re.sub("</?i>", "", text)


def test_a_plot_without_a_finite_number_says_so() -> None:
    text = page("t", (), (Chapter("c", plots=(plot(line([float("nan")] * 3)),)),))
    assert "No finite data to plot." in text and "data-plot=" not in text


def test_a_long_line_is_decimated_and_retains_its_peak_and_gap() -> None:
    y = np.random.default_rng(1).normal(size=200_000)
    y[123_456], y[7] = 40.0, np.nan
    x, thin = decimated(np.arange(len(y), dtype=np.float64), y)
    assert len(x) <= 1.1 * LINE_SAMPLES and np.all(np.diff(x) > 0)
    assert thin[x == 123_456.0] == 40.0 and np.isnan(thin[x == 7.0]).all() and 7.0 in x


@pytest.mark.parametrize("x", [np.zeros(50), np.repeat([1.0, 2.0], 25), np.random.default_rng(2).normal(size=50)])
def test_points_have_ascending_x_and_hardly_move(x: np.ndarray) -> None:
    """uPlot drops points of equal x."""
    data = plot_data(plot(Series("", x, np.arange(50.0), MEASURED, POINTS)))
    assert data is not None
    moved = np.array(data["columns"][data["series"][0]["x"]])
    assert np.all(np.diff(moved) > 0)
    assert np.max(np.abs(moved - np.sort(x))) < 1e-4 * max(np.ptp(x), 1.0)


def test_a_truth_outside_its_interval_is_marked() -> None:
    inside, outside = (Intervals("", (Bar("K", Estimate("K", "-", 1, 1, 0, 2), truth),)) for truth in (1.5, 2.5))
    texts = [page("t", (), (Chapter("c", plots=(one,)),)) for one in (inside, outside)]
    assert ['class="number out"' in text for text in texts] == [False, True]


def test_intervals_of_any_size_stay_inside_of_their_axis() -> None:
    infinite = Estimate("K", "-", 1.0, 1.0, -np.inf, np.inf)
    bars = tuple(
        Bar(name, one) for name, one in (("a", Estimate("M_q", "1/s", -1.5, 0.1, -1.7, -1.3)), ("b", infinite))
    )
    text = page("t", (), (Chapter("c", plots=(Intervals("", bars),)),))
    lefts = [float(one) for one in re.findall(r"left:([\d.]+)%", text)]
    assert len(lefts) >= 4 and all(0.0 <= one <= 100.0 for one in lefts) and "inf%" not in text


def test_findings_have_code_severity_and_remedy() -> None:
    remark = Remark("warning", "time_skew", "Alpha is late by 0.1 s.", "shift it with delay")
    text = page("t", (), (Chapter("c", findings=(remark,)),))
    assert '<li class="warning"><b>warning</b> <code>time_skew</code>' in text
    assert "Remedy: shift it with delay." in text


def test_numbers_are_right_aligned_and_words_left() -> None:
    rows = (("a", "0.58 (0.44 to 0.71)", "in 15 of 26 *", "12.5", "circuit"), ("b", None, "in 2 of 9", "−3", "7 km"))
    text = page("t", (), (Chapter("c", (), (Table(("name", "m", "p", "n", "w"), rows, "caption"),)),))
    heads = re.findall(r"<th( class=\"number\")?>(\w)", text)
    assert {name for right, name in heads if right} == {"m", "p", "n"}
    assert '<p class="caption">caption</p>' in text


def test_a_line_for_the_signature_is_on_request() -> None:
    assert ["Signature" in page("t", (), (Chapter("c"),), signed) for signed in (True, False)] == [True, False]


def test_an_existing_page_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "mine.html"
    path.write_text("mine")
    with pytest.raises(InputError, match="is not overwritten"):
        write_page(path, "t", (), (Chapter("c"),))
    assert path.read_text() == "mine"
