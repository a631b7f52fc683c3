"""The page of an identification: what it says, that it holds everything itself, and that nothing is overwritten."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly
from wing_drives import K_TAU, K_TAU0, Drives, measure, simulate

from logs.identification.estimators import stroke_coefficients as stroke_fits
from logs.identification.estimators.flapping_frequency import FrequencyModel, Segment
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.estimators.servo import identify_torque
from logs.identification.estimators.servo_power import identify_power
from logs.identification.estimators.wing_coefficients import AeroResult, CoefficientModel
from logs.identification.report import Identification
from logs.identification.report.document import (
    DASHED,
    MEASURED,
    POINTS,
    STEMS,
    STEPS,
    Band,
    Bar,
    Chapter,
    Intervals,
    Matrix,
    Plot,
    Series,
    Table,
)
from logs.identification.report.html import page
from logs.identification.report.labels import meaning, number, rich, symbol
from logs.identification.report.numbers import determined
from logs.identification.report.report import Subject, chapters, refuse_existing, write_report
from logs.identification.report.svg import NARROW, axis, drawn, round_step, written
from logs.identification.results import Estimate, Unidentified, estimate
from logs.identification.statistics.fit_quality import BAND, autocorrelation
from logs.identification.tables import benches
from logs.identification.tables import load_cell_tests as stands
from wingbeat.errors import InputError

SUBJECT = Subject("bird: identification", "flight.mcap", "ab" * 32, (("vehicle", "bird"), ("length", "20.0 s")))
TRUTHS = {"K_tau": K_TAU, "K_tau0": K_TAU0, "short_period_frequency": 11.0, "short_period_damping": 0.6}


class Outline(HTMLParser):
    """Headings, visible words and tags that are not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.headings: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "link"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ("h1", "h2", "h3", "h4"):
            self.headings.append(data)
        if "style" not in self.open:
            self.words.append(data)


@pytest.fixture(scope="module")
def found() -> Identification:
    modes = identify_modes(fly(Flight(seed=2)), AIRCRAFT)
    drive = measure(simulate(Drives(duration=20.0)), Drives(duration=20.0))
    return Identification(identify_torque(drive), identify_power(drive), modes=modes, truths=TRUTHS)


@pytest.fixture(scope="module")
def report(found: Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    drive = measure(simulate(Drives(duration=20.0)), Drives(duration=20.0))
    path = tmp_path_factory.mktemp("report") / "bird.html"
    assert write_report(path, SUBJECT, found, drive) == path.stat().st_size < 2_000_000
    return path


# --- the whole page ---------------------------------------------------------------------------------------------


def test_every_chapter_is_there_and_every_tag_is_closed(report: Path) -> None:
    outline = Outline(report.read_text(encoding="utf-8"))
    assert outline.open == []
    for title in (
        "Findings", "Data used", "Modes", "Drive servos", "Model", "Parameters", "Correlation of the estimates",
        "Fits", "Residuals", "Validation on held-out manoeuvres", "Torque", "Power", "Short period", "output error",
    ):  # fmt: skip
        assert title in outline.headings
    findings = report.read_text(encoding="utf-8").partition(">Findings</h2>")[2].partition("<h2")[0]
    assert "output power at the centre of the data" in findings and "torque at no current" in findings
    words = " ".join(outline.words)
    for said in (SUBJECT.sha256, "Used: 6 manoeuvres", "2 of 6 maneuvers were held out", "agree", "Theil"):
        assert said in words


def test_the_numbers_of_the_page_are_those_that_were_found(report: Path, found: Identification) -> None:
    words = " ".join(Outline(report.read_text(encoding="utf-8")).words)
    assert found.torque is not None and found.modes is not None
    frequency = found.modes.modes[0].frequency
    assert frequency is not None
    for one in (*found.torque.estimates, frequency, *found.modes.modes[0].derivatives):
        assert number(one.value, one.standard_error) in words
        assert f"{number(one.low, one.standard_error)} to {number(one.high, one.standard_error)}" in words


def test_held_out_manoeuvres_are_predicted_by_a_model_that_never_saw_them(found: Identification) -> None:
    told = chapters(SUBJECT, found)
    validation = next(one for one in told if one.title.startswith("Validation"))
    table = validation.parts[0].tables[0]
    r_squared = {row[0]: row[3] for row in table.rows}
    assert set(r_squared) == {"q", "a_x", "a_z"}
    assert isinstance(r_squared["q"], float) and 0.9 < r_squared["q"] < 1.0
    drawn = [part.title for part in validation.parts[0].parts]
    assert len(drawn) == 2 and all(title.startswith("maneuver") for title in drawn)


def test_a_page_needs_no_network_and_no_script(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=[\"'](?!#|data:)", text)
    assert "<script" not in text and "@import" not in text and "url(" not in text


def test_what_was_not_found_is_said_with_its_reason(found: Identification) -> None:
    modes = found.modes
    assert modes is not None
    alone = modes._replace(maneuvers=(), results=())
    words = page("t", (), chapters(SUBJECT, Identification(modes=alone)))
    assert "Validation" not in words and "Drive servos" not in words
    for mode in modes.modes:
        for one in mode.unidentified:
            assert one.reason.replace("'", "&#x27;") in words


def test_an_existing_file_is_refused_before_and_after_the_work(tmp_path: Path, found: Identification) -> None:
    path = tmp_path / "kept.html"
    path.write_text("mine", encoding="utf-8")
    for attempt in (lambda: refuse_existing(path), lambda: write_report(path, SUBJECT, found)):
        with pytest.raises(InputError, match=r"kept.html exists: it is not overwritten$"):
            attempt()
    assert path.read_text(encoding="utf-8") == "mine"
    with pytest.raises(InputError, match=r"there is no folder"):
        refuse_existing(tmp_path / "nowhere" / "a.html")


# --- its parts --------------------------------------------------------------------------------------------------


def line(y: list[float], style: str = "line") -> Series:
    return Series("<b>", np.arange(len(y), dtype=np.float64), np.array(y), MEASURED, style)


def test_every_kind_of_picture_is_drawn_with_finite_numbers() -> None:
    nan = float("nan")
    series = (line([1.0, nan, 3.0]), *(line([0.0, 2.0, 1.0], style) for style in (DASHED, POINTS, STEMS, STEPS)))
    ends = np.array([0.0, 2.0])
    plot = Plot("a < b", "x", "s", "y", "m/s^2", series, (Band("band", ends, ends - 1, ends + 1),))
    shown = Intervals(
        "", (Bar("X_u", estimate("X_u", "1/s", -1.0, 0.1), -3.0), Bar("K", Estimate("K", "-", 1, 1, 0, 2)))
    )
    text = page("t", (), (Chapter("c", ("a & b",), plots=(plot, shown, Matrix("", ("a", "b"), np.eye(2)))),))
    assert Outline(text).open == []
    assert "a &amp; b" in text and "&lt;b&gt;" in text and "m/s²" in text
    for path in re.findall(r' (?:d|points|x|cx|width)="([^"]*)"', text):
        assert "nan" not in path and "inf" not in path


def test_a_plot_without_a_finite_number_says_so() -> None:
    text = page("t", (), (Chapter("c", plots=(Plot("", "x", "s", "y", "-", (line([float("nan")] * 3),)),)),))
    assert "Nothing finite to draw." in text and "<svg" not in text


def test_a_truth_outside_its_interval_stands_out() -> None:
    inside, outside = (Intervals("", (Bar("K", Estimate("K", "-", 1, 1, 0, 2), truth),)) for truth in (1.5, 2.5))
    texts = [page("t", (), (Chapter("c", plots=(one,)),)) for one in (inside, outside)]
    assert ['class="number out"' in text for text in texts] == [False, True]


def test_a_long_line_is_thinned_to_what_the_eye_sees() -> None:
    rng = np.random.default_rng(1)
    y = rng.normal(size=200_000)
    y[123_456] = 40.0
    text = page("t", (), (Chapter("c", plots=(Plot("", "x", "s", "y", "-", (line(list(y)),)),)),))
    assert len(text) < 200_000
    path = re.search(r'class="measured line" d="([^"]*)"', text)
    assert path is not None
    heights = [float(pair.split()[1]) for pair in re.findall(r"[ML]([\d.]+ [\d.]+)", path[1])]
    # The one spike is the highest point of the plot, far above all others.
    assert min(heights) < sorted(heights)[1] - 50


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 1.0), (-3e-5, 7e-5), (999.2, 999.9), (-4e6, 9e6), (2.0, 2.0), (-4.1, 4.0), (3.9996, 4.0005)],
)
def test_an_axis_has_round_numbers_inside_it_that_differ_as_text(low: float, high: float) -> None:
    one = axis(low, high, 50.0, 350.0, 5)
    assert 4 <= len(one.ticks) <= 11
    assert all(one.low - 1e-9 * abs(one.low) <= tick <= one.high + 1e-9 * abs(one.high) for tick in one.ticks)
    texts = [written(tick, one.ticks[1] - one.ticks[0]) for tick in one.ticks]
    assert len(set(texts)) == len(texts)


def test_a_plot_whose_span_is_just_above_a_round_step_has_three_numbers() -> None:
    """With a step of 5 there would be a zero alone on it."""
    assert axis(-4.1, 4.1, 150.0, 20.0, 4).ticks == (-4.0, -2.0, 0.0, 2.0, 4.0)


def test_every_group_of_bars_tells_where_its_picture_begins_and_ends() -> None:
    wide = Intervals(
        "", (Bar("a", Estimate("M_q", "1/s", -1.5, 0.1, -1.7, -1.3)), Bar("b", Estimate("K", "-", 1, 1, 0, 2)))
    )
    text = page("t", (), (Chapter("c", (), (), (wide,)),))
    ends = re.findall(r'<tr class="scale">.*?<span>(.*?)</span><span>(.*?)</span>', text)
    assert len(ends) == 2
    low, high = (float(one.replace("−", "-")) for one in ends[0])
    assert low == pytest.approx(-1.7, abs=0.15) and high == pytest.approx(0.1, abs=0.05)


def test_what_follows_from_a_damping_that_may_be_next_to_none_is_not_determined() -> None:
    sure = Estimate("phugoid_time_to_half", "s", 2.3, 1.0, 1.3, 11.1)
    open_one = Estimate("phugoid_cycles_to_half", "-", 0.7, 2.0, 0.33, 19.2)
    frequency = Estimate("phugoid_frequency", "rad/s", 1.0, 0.5, 0.05, 2.0)
    told, wide = determined([frequency, sure, open_one])
    assert told == [frequency, sure]
    assert wide == [Unidentified("phugoid_cycles_to_half", "the data allow 0.33 to 19.2")]


def test_numbers_in_words_stand_to_the_right_and_words_to_the_left() -> None:
    rows = (("a", "0.58 (0.44 to 0.71)", "in 15 of 26 *", "12.5", "circuit"), ("b", None, "in 2 of 9", "−3", "7 km"))
    text = page("t", (), (Chapter("c", (), (Table(("name", "m", "p", "n", "w"), rows),)),))
    heads = re.findall(r"<th( class=\"number\")?>(\w)", text)
    assert {name for right, name in heads if right} == {"m", "p", "n"}


def test_steps_are_one_two_or_five() -> None:
    assert [round_step(value) for value in (0.011, 0.2, 2.1, 501.0)] == pytest.approx([0.02, 0.2, 5.0, 1000.0])


def test_numbers_have_the_digits_that_their_error_leaves() -> None:
    assert number(-11.6543, 0.32) == "−11.65"
    assert number(1234.56, 30.0) == "1235"
    assert number(-0.00001, 0.2) == "0"
    assert number(float("nan")) == "–"


def test_symbols_have_subscripts_and_file_names_have_none() -> None:
    assert symbol("X_delta") == "<i>X</i><sub>δ</sub>"
    assert symbol("K_tau0") == "<i>K</i><sub>τ0</sub>"
    assert symbol("short_period_damping") == "short period damping"
    assert symbol("C_T_0") == "<i>C</i><sub>T0</sub>"
    slope = "<i>C</i><sub>L</sub> by <i>v</i><sub>z</sub> <i>θ\u0307</i><sub>11</sub><sup>2</sup>"
    assert symbol("C_L_v_z*theta_11_rate^2") == slope
    assert symbol("v_z*theta_11_rate") == "<i>v</i><sub>z</sub> <i>θ\u0307</i><sub>11</sub>"
    assert rich("short_period_damping of v_z^2") == "short period damping of <i>v</i><sub>z</sub><sup>2</sup>"
    assert rich("M_w of b_1.mcap, a_flight.mcap") == "<i>M</i><sub>w</sub> of b_1.mcap, a_flight.mcap"


def test_an_equation_is_set_in_one_kind_of_type() -> None:
    told = rich("p' = L_beta beta + L_p p - 0.5 L_delta_a delta_a")
    assert told == (
        "<i>p</i>&#x27; = <i>L</i><sub>β</sub> <i>β</i> + <i>L</i><sub>p</sub> <i>p</i>"
        " − 0.5 <i>L</i><sub>δa</sub> <i>δ</i><sub>a</sub>"
    )
    assert rich("a - b") == "a - b", "a sentence's words stay as they are"


@pytest.mark.parametrize(
    "text",
    [*stands.EQUATIONS, *stroke_fits.EQUATIONS, *stroke_fits.LAWS, stroke_fits.MOMENT_LAW, *benches.LINE,
     *benches.RELEASE],
)  # fmt: skip
def test_words_with_an_apostrophe_stay_words_in_what_begins_as_an_equation(text: str) -> None:
    assert "&#x27;<i>" not in rich(text)
    assert ("'s " in text) == ("&#x27;s " in rich(text))


def test_a_derivative_by_a_control_goes_by_the_controls_name_by_path() -> None:
    assert meaning("M_delta") == "nose-up pitch acceleration by tail angle"
    assert meaning("M_delta", ("elevator",)) == "nose-up pitch acceleration by elevator"
    assert meaning("L_delta_a", ("delta_a", "delta_r")) == "roll acceleration by delta_a"
    assert meaning("L_beta", ("delta_a", "beta")) == "roll acceleration by sideslip"
    bars = (Bar("M_delta", estimate("M_delta", "1/s^2", -6.0, 0.1), meaning="pitch by delta_e"),)
    assert "pitch by <i>δ</i><sub>e</sub>" in page("t", (), (Chapter("c", plots=(Intervals("", bars),)),))


@pytest.mark.parametrize("reach", [1.0, 0.0142, 0.0009, 3e-5, 4e6])
@pytest.mark.parametrize("centre", [0.0, 1.0])
def test_numbers_below_a_small_plot_do_not_touch(reach: float, centre: float) -> None:
    x = reach * (centre + np.linspace(-1.0, 0.9, 50))
    text = drawn(Plot("", "x", "", "y", "", (Series("", x, x),)), NARROW)
    below = re.findall(r'<text x="([\d.]+)" y="[\d.]+" text-anchor="middle">([^<]+)</text>', text)
    assert len(below) >= 2
    ends = [(float(at) - 3.2 * len(told), float(at) + 3.2 * len(told)) for at, told in below]
    assert all(after[0] - before[1] > 4.0 for before, after in pairwise(ends)), below


def test_white_residuals_stay_in_the_band_and_coloured_ones_leave_it() -> None:
    rng = np.random.default_rng(5)
    white = [rng.normal(size=400) for _ in range(5)]
    values, pairs = autocorrelation(white, 40)
    assert values[0] == pytest.approx(1.0)
    assert np.mean(np.abs(values[1:]) < BAND / np.sqrt(pairs[1:])) > 0.85
    coloured = [np.convolve(one, np.ones(10), "valid") for one in white]
    values, _ = autocorrelation(coloured, 40)
    assert values[5] == pytest.approx(0.5, abs=0.1)


def test_a_tables_numbers_are_on_the_right() -> None:
    text = page("t", (), (Chapter("c", tables=(Table(("name", "x"), (("a", 1.5), ("b", None)), "told"),)),))
    assert '<th class="number">x</th>' in text and "<th>name</th>" in text and "<caption>told</caption>" in text


def test_wings_and_their_coefficients_have_chapters_with_every_number_and_step() -> None:
    lift = tuple(estimate(f"C_L_{term}", "-", value, 0.01) for term, value in (("0", 0.31), ("v_x", 0.197)))
    refused = Unidentified("C_T", "its terms tell 20 % of it")
    aero = AeroResult(
        (
            CoefficientModel("C_L", ("v_x",), lift, (), (), 0.934, 1200),
            CoefficientModel("C_T", (), (), (refused,), (), 0.2, 1200),
        ),
        ("flight.mcap",),
        ("twist: not measured, taken for none",),
    )
    stretches = tuple(Segment(k, k + 1.0, 0.3 + 0.1 * k, 3.0 + k, 5, 8.0) for k in range(4))
    frequency = FrequencyModel((estimate("throttle_slope", "Hz", 9.96, 0.1),), (), 0.45, 8.0, 0.02, stretches)
    found = Identification(frequency=frequency, aero=aero)
    words = page("t", (), chapters(SUBJECT, found))
    for said in ("0.31", "0.197", "93.4 %", "its terms tell 20 % of it", "Twist: not measured", "9.96"):
        assert said in words
