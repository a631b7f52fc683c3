"""Report of an identification from logs: chapters, numbers, findings, and files that are not overwritten."""

from __future__ import annotations

import html
import math
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from linear_ornithopter import AIRCRAFT, Flight, fly
from wing_drives import K_TAU, K_TAU0, Drives, measure, simulate

from logs.identification.estimators import bench as bench_fits
from logs.identification.estimators import stroke_coefficients as stroke_fits
from logs.identification.estimators.flapping_frequency import FrequencyResult, Segment
from logs.identification.estimators.flight_modes import identify_modes
from logs.identification.estimators.model_structure import Statistics
from logs.identification.estimators.servo import identify_torque
from logs.identification.estimators.servo_power import identify_power
from logs.identification.estimators.stepwise import Step
from logs.identification.estimators.wing_coefficients import CANDIDATES, AeroResult
from logs.identification.findings import not_estimated
from logs.identification.models.inverse_dynamics import STATES
from logs.identification.report import Identification
from logs.identification.report.numbers import determined
from logs.identification.report.report import Subject, chapters, write_report
from logs.identification.results import Estimate, estimate, linear_result
from logs.identification.sources.table import stand as stands
from logs.identification.statistics.fit_quality import BAND, autocorrelation
from logs.pages.document import (
    Bar,
    Chapter,
    Intervals,
)
from logs.pages.labels import REGRESSORS, meaning, number, rich, sentence, spaced, symbol, text_symbol, unit
from logs.pages.render import page, refuse_existing
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
        if not {"style", "script"} & set(self.open):
            self.words.append(data)


@pytest.fixture(scope="module")
def identified() -> Identification:
    modes = identify_modes(fly(Flight(seed=2)), AIRCRAFT)
    drive = measure(simulate(Drives(duration=20.0)), Drives(duration=20.0))
    return Identification(identify_torque(drive), identify_power(drive), modes=modes, truths=TRUTHS)


@pytest.fixture(scope="module")
def report(identified: Identification, tmp_path_factory: pytest.TempPathFactory) -> Path:
    drive = measure(simulate(Drives(duration=20.0)), Drives(duration=20.0))
    path = tmp_path_factory.mktemp("report") / "bird.html"
    assert write_report(path, SUBJECT, identified, drive) == path.stat().st_size < 2_000_000
    return path


# --- the whole page ---------------------------------------------------------------------------------------------


def test_every_chapter_is_there_and_every_tag_is_closed(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    outline = Outline(text)
    assert outline.open == []
    for title in (
        "Summary", "Data", "Modes", "Drive servos", "Model", "Torque", "Power", "Short period", "Output error",
        "Filter error", "Correlation of the estimates", "Measured and modeled outputs", "Residuals",
        "Validation on held-out maneuvers",
    ):  # fmt: skip
        assert title in outline.headings
    summary = text.partition(">Summary</h2>")[2].partition("<h2")[0]
    assert "output power at the center of the data" in summary and "torque at zero current" in summary
    words = " ".join(outline.words)
    for part in (SUBJECT.sha256, "6 maneuvers", "2 of 6 maneuvers were held out", "agree", "Theil", "Signature"):
        assert part in words


def test_the_numbers_of_the_page_are_those_that_were_found(report: Path, identified: Identification) -> None:
    words = " ".join(Outline(report.read_text(encoding="utf-8")).words)
    assert identified.torque is not None and identified.modes is not None
    frequency = identified.modes.modes[0].frequency
    assert frequency is not None
    for one in (*identified.torque.estimates, frequency, *identified.modes.modes[0].derivatives):
        assert number(one.value, one.standard_error) in words
        assert f"{number(one.low, one.standard_error)} to {number(one.high, one.standard_error)}" in words


def part(chapter: Chapter, title: str) -> Chapter:
    return next(one for one in chapter.parts if one.title == title)


def test_held_out_maneuvers_are_predicted(identified: Identification) -> None:
    by_output = next(one for one in chapters(SUBJECT, identified) if one.title == "Output error")
    validation = part(by_output, "Validation on held-out maneuvers")
    r_squared = {row[0]: row[3] for row in validation.tables[0].rows}
    assert set(r_squared) == {"q", "a_x", "a_z"}
    assert isinstance(r_squared["q"], float) and 0.9 < r_squared["q"] < 1.0
    assert all(len(plot.marks) == 2 for plot in validation.plots)
    assert all(label.startswith("maneuver") for plot in validation.plots for _, label in plot.marks)


def test_filter_error_predicts_from_the_first_sample(identified: Identification) -> None:
    """GIVEN accelerations about gravity, not about zero, WHEN filter error predicts them, THEN from the first on."""
    by_filter = next(one for one in chapters(SUBJECT, identified) if one.title == "Filter error")
    outputs = part(by_filter, "Measured and modeled outputs")
    r_squared = {row[0]: row[3] for row in outputs.tables[0].rows}
    assert all(isinstance(value, float) and value > 0.8 for value in r_squared.values())
    for plot in outputs.plots:
        measured, model = (one.y for one in plot.series)
        assert abs(measured[0] - model[0]) < 0.5 * np.nanstd(measured)


def cells(every: tuple[Chapter, ...]) -> list[str]:
    own = [
        cell for one in every for table in one.tables for row in table.rows for cell in row if isinstance(cell, str)
    ]
    return own + [cell for one in every for cell in cells(one.parts)]


def test_a_cell_of_a_table_has_at_most_twelve_words(identified: Identification) -> None:
    every = cells(chapters(SUBJECT, identified))
    assert len(every) > 50 and max(len(cell.split()) for cell in every) <= 12


def test_at_most_five_correlations_are_listed(identified: Identification) -> None:
    listed = [p for one in chapters(SUBJECT, identified) for p in one.parts if p.title.startswith("Correlation")]
    assert listed and all(1 <= len(one.tables[0].rows) <= 5 for one in listed)


def test_a_page_needs_no_network(report: Path) -> None:
    text = report.read_text(encoding="utf-8")
    assert not re.search(r"(?:src|href)=[\"'](?!#|data:)", text)
    assert "@import" not in text and "url(" not in text


def test_what_was_not_found_is_said_with_its_reason(identified: Identification) -> None:
    modes = identified.modes
    assert modes is not None
    alone = modes._replace(maneuvers=(), results=())
    words = page("t", (), chapters(SUBJECT, Identification(modes=alone)))
    assert "Validation on" not in words and "Drive servos" not in words
    for mode in modes.modes:
        for one in mode.withheld:
            assert html.escape(sentence(one.text))[1:] in words


def test_an_existing_file_is_refused_before_and_after_the_work(tmp_path: Path, identified: Identification) -> None:
    path = tmp_path / "kept.html"
    path.write_text("mine", encoding="utf-8")
    for attempt in (lambda: refuse_existing(path), lambda: write_report(path, SUBJECT, identified)):
        with pytest.raises(InputError, match=r"kept.html exists: it is not overwritten$"):
            attempt()
    assert path.read_text(encoding="utf-8") == "mine"
    with pytest.raises(InputError, match=r"there is no folder"):
        refuse_existing(tmp_path / "nowhere" / "a.html")


# --- its parts ----------------------------------------------------------------------------------------------------


def test_what_follows_from_a_damping_that_may_be_next_to_none_is_not_determined() -> None:
    sure = Estimate("phugoid_time_to_half", "s", 2.3, 1.0, 1.3, 11.1)
    open_one = Estimate("phugoid_cycles_to_half", "-", 0.7, 2.0, 0.33, 19.2)
    frequency = Estimate("phugoid_frequency", "rad/s", 1.0, 0.5, 0.05, 2.0)
    told, wide = determined([frequency, sure, open_one])
    assert told == [frequency, sure]
    assert wide == [not_estimated("phugoid_cycles_to_half", "the data allow 0.33 to 19.2")]


def test_numbers_have_the_digits_that_their_error_leaves() -> None:
    assert number(-11.6543, 0.32) == "−11.65"
    assert number(1234.56, 30.0) == "1235"
    assert number(-0.00001, 0.2) == "0"
    assert number(float("nan")) == "–"


def test_symbols_have_subscripts_and_file_names_have_none() -> None:
    assert symbol("X_delta") == "<i>X</i><sub>δ</sub>"
    assert symbol("K_tau0") == "<i>K</i><sub>τ0</sub>"
    assert symbol("short_period_damping") == "<i>ζ</i><sub>sp</sub>"
    assert symbol("process_noise_alpha") == "<i>σ</i><sub>α</sub>" and unit("(rad)/s^0.5") == "rad/√s"
    assert [spaced(name) for name in ("bias_a_x", "C_H", "dead_zone")] == ["bias of a_x", "C_H", "dead zone"]
    assert symbol("C_T_0") == "<i>C</i><sub>T0</sub>"
    slope = "<i>C</i><sub>L, <i>v</i><sub>z</sub> <i>θ\u0307</i><sub>11</sub><sup>2</sup></sub>"
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
    [*stands.EQUATIONS, *stroke_fits.EQUATIONS, *stroke_fits.LAWS, stroke_fits.MOMENT_LAW, *bench_fits.EQUATIONS,
     *bench_fits.RELEASE],
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


def test_white_residuals_stay_in_the_band_and_coloured_ones_leave_it() -> None:
    rng = np.random.default_rng(5)
    white = [rng.normal(size=400) for _ in range(5)]
    values, pairs = autocorrelation(white, 40)
    assert values[0] == pytest.approx(1.0)
    assert np.mean(np.abs(values[1:]) < BAND / np.sqrt(pairs[1:])) > 0.85
    coloured = [np.convolve(one, np.ones(10), "valid") for one in white]
    values, _ = autocorrelation(coloured, 40)
    assert values[5] == pytest.approx(0.5, abs=0.1)


def test_wings_and_their_coefficients_have_chapters_with_every_number_and_step() -> None:
    lift = tuple(estimate(f"C_L_{term}", "-", value, 0.01) for term, value in (("0", 0.31), ("v_x", 0.197)))
    refused = not_estimated("C_T", "its terms tell 20 % of it")
    nothing = (math.nan,) * 4
    entered = Step("enters", "v_x", "", *nothing, ("v_x",), Statistics(*(0.934 for _ in Statistics._fields)))
    aero = AeroResult(
        (
            linear_result("stepwise", lift, title="C_L", steps=(entered,), samples=1200),
            linear_result("stepwise", (), (refused,), title="C_T", samples=1200),
        ),
        ("flight.mcap",),
        ("twist: not measured, taken for none",),
    )
    stretches = tuple(Segment(k, k + 1.0, 0.3 + 0.1 * k, 3.0 + k, 5, 8.0) for k in range(4))
    frequency = FrequencyResult(
        linear_result("frequency", (estimate("throttle_slope", "Hz", 9.96, 0.1),), fixed={"T_c": 0.45, "V_c": 8.0}),
        stretches,
    )
    identified = Identification(frequency=frequency, aero=aero)
    words = page("t", (), chapters(SUBJECT, identified))
    for said in ("0.31", "0.197", "R² = 0.9340", "its terms tell 20 % of it", "Twist: not measured", "9.96"):
        assert said in words


def test_every_regressor_of_the_wing_coefficients_has_symbol_unit_and_meaning() -> None:
    """GIVEN the terms of Grauer's model THEN labels, the guide and the terminal define each of them."""
    guide = (Path(__file__).parents[3] / "docs" / "identify_csv.md").read_text(encoding="utf-8")
    for name, si in STATES.items():
        assert REGRESSORS[name][0] == si and f"| `{name}` |" in guide
    for term in CANDIDATES:
        assert meaning(f"C_L_{term}").startswith("lift coefficient by ")
        assert not {"theta", "omega", "*"} & set(text_symbol(f"C_L_{term}").split("_"))
    assert text_symbol("C_m_theta_11*theta_11_rate") == "C_m θ₁₁ θ\u0307₁₁" and text_symbol("C_m_0") == "C_m_0"
