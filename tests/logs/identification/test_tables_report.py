"""`--report` and `--model` of a table: its page, and the linear model of its derivatives."""

from __future__ import annotations

import hashlib
import html
import io
import json
import re
import runpy
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console, RenderableType

from groundstation.command import identify
from groundstation.views.identification import identification_table
from groundstation.views.table_identification import table_identification
from logs.identification.data.flight import Aircraft
from logs.identification.data.maneuvers import Reference
from logs.identification.diagnostics.agreement import agreement
from logs.identification.findings import Finding
from logs.identification.models.modes import Mode, ModesResult, Oscillation, nothing
from logs.identification.models.stroke_averaged import matrices
from logs.identification.report import Identification
from logs.identification.report.tables import Source, table_chapters, table_document, write_tables_report
from logs.identification.results import EstimationResult, estimate
from logs.identification.sources.table.run import TableIdentification
from logs.pages.labels import number, rich, sentence, symbol
from sim_bridge.tuning.model import load_model
from wingbeat.errors import InputError

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
MADE = runpy.run_path(str(EXAMPLES / "make_tables.py"))
SPEED, PITCH, ALPHA, ELEVATOR = 8.0, 0.15, 0.1, -0.05
TRUTH = {
    "X_u": -0.4, "X_w": 0.5, "X_q": 0.0, "X_delta": 0.0, "Z_u": -1.5, "Z_w": -5.0, "Z_q": 0.0, "Z_delta": -4.0,
    "M_u": 0.2, "M_w": -4.0, "M_q": -6.0, "M_delta": -60.0,
}  # fmt: skip
MAP = """
[time]
column = "t"
[signals]
u = { column = "u", unit = "m/s" }
alpha = { column = "alpha", unit = "rad" }
q = { column = "q", unit = "rad/s" }
theta = { column = "theta", unit = "rad" }
delta_e = { column = "delta_e", unit = "rad" }
[constants]
V = 8.0
theta = 0.15
alpha = 0.1
flapping = 4.0
rho = 1.2
[modes]
model = "longitudinal"
inputs = ["delta_e"]
outputs = ["u", "alpha", "q", "theta"]
[modes.parameters]
X_u = "free"
X_alpha = "free"
X_delta = 0.0
Z_u = "free"
Z_alpha = "free"
Z_delta = "free"
M_u = "free"
M_alpha = "free"
M_q = "free"
M_delta_e = "free"
"""


def about() -> Reference:
    return Reference(SPEED * np.cos(ALPHA), SPEED * np.sin(ALPHA), PITCH, SPEED)


@cache
def table() -> str:
    """A 3-2-1-1 of the elevator, nose down positive, at 50 Hz; little noise."""
    system = matrices(tuple(TRUTH), np.array(list(TRUTH.values())), about(), Aircraft())
    t = np.arange(0, 12, 0.02)
    delta = 0.05 * MADE["multistep"](t, 0.5, 0.2) + 0.1 * ((t > 5) & (t < 6))

    def rates(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(system.a @ x + system.b * u[0])

    states = MADE["fly"](rates, np.zeros(4), delta[:, None], 0.02, 4)
    # As a vane tells it: the angle follows the forward speed too.
    states[:, 1] = (np.cos(ALPHA) * states[:, 1] - np.sin(ALPHA) * states[:, 0]) / SPEED
    rng = np.random.default_rng(3)
    noisy = states + rng.normal(0, 1, states.shape) * [0.02, 0.002, 0.01, 0.002] + [0.0, ALPHA, 0.0, PITCH]
    rows = np.column_stack((t, noisy, delta - ELEVATOR))
    return "t,u,alpha,q,theta,delta_e\n" + "".join(",".join(f"{v:.8g}" for v in row) + "\n" for row in rows)


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "run.csv").write_text(table())
    (tmp_path / "map.toml").write_text(MAP)
    return tmp_path / "run.csv", tmp_path / "map.toml"


def run(files: tuple[Path, Path], *more: str) -> int:
    return identify.run([str(files[0]), "--map", str(files[1]), *more])


def test_a_tables_page_has_the_chapters_numbers_and_hashes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = EXAMPLES / "short_period.csv", EXAMPLES / "short_period.toml"
    assert run(both, "--report", str(tmp_path / "page.html"), "--json") == 0
    document, text = json.loads(capsys.readouterr().out), (tmp_path / "page.html").read_text(encoding="utf-8")
    for title in (
        "Summary", "Data", "Modes", "Model", "Output error, short period", "Measured and modeled outputs",
        "Residuals", "Validation on held-out maneuvers",
    ):  # fmt: skip
        assert f">{title}</h" in text
    for path in both:
        assert hashlib.sha256(path.read_bytes()).hexdigest() in text
    for fit in document["fits"]:
        for one in fit["estimates"]:
            assert f">{number(one['value'], one['standard_error'])}<" in text
        for one in fit["findings"]:
            assert f"<code>{one['code']}</code>" in text
    model, summary = (text.partition(f">{title}</h2>")[2].partition("<h2")[0] for title in ("Model", "Summary"))
    assert "Fixed, not estimated: <i>Z</i><sub>q</sub> = 0." in model
    assert '<td class="name"><i>M</i><sub>q</sub></td>' in summary and '<td class="name">intercept</td>' in summary
    assert "<i>a</i><sub>z</sub> = 100 <i>Z</i><sub>α</sub> <i>α</i> + 100 <i>Z</i><sub>q</sub> <i>q</i>" in model
    assert "by tail angle" not in text and "pitch acceleration by <i>δ</i><sub>e</sub>" in summary
    assert "25 of 351 samples of <i>α</i> not measured" in text
    assert "2 maneuvers fitted, 1 held out" in text and "Theil" in text
    for method in document["modes"]["methods"]:
        for one in method["unidentified"]:
            assert html.escape(one["reason"]) in text


def test_the_steps_of_a_stepwise_regression_are_on_the_page(tmp_path: Path) -> None:
    both = EXAMPLES / "transport.csv", EXAMPLES / "transport.toml"
    assert run(both, "aero", "--report", str(tmp_path / "page.html")) == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "Stepwise regression" in text and "PRESS" in text and text.count(">enters<") == 3
    assert "No maneuver was held out" in text
    (fixed,) = re.findall(r"Fixed, not estimated.*?</p>", re.sub(r"</?(?:i|sub)>", "", text))
    assert re.findall(r"C\w+(?= = 0[,.])", fixed) == [
        "CDV", "CDα2", "CDk", "CDq", "CDδ", "CLV", "CLα2", "CLq", "CLδ", "CmV", "Cmα2",
    ] and fixed.count("=") == 11  # fmt: skip


def test_what_a_fit_holds_is_told_fit_by_fit_and_what_it_could_not_find_is_not_held() -> None:
    equations = ("x' = X_u u + X_w w + X_q q",)
    lost = (Finding("no_effect", "withheld", "X_w"),)
    first, second = (
        EstimationResult(
            "output_error", "aero", "test", equations, estimates=(estimate("X_u", "1/s", -0.4, 0.1),), samples=100,
            findings=lost, fixed={"X_q": value}, unnamed={"X_p": 0.0}, title="output error",
        )
        for value in (0.1, 0.2)
    )  # fmt: skip

    def notes(*fits: EstimationResult) -> tuple[str, ...]:
        chapters = table_chapters((), TableIdentification((), (), (), fits, None))
        (part,) = next(one for one in chapters if one.title == "Model").parts
        return part.notes

    assert notes(first) == notes(first, first) == (*equations, "Fixed, not estimated: X_p = 0, X_q = 0.1.")
    assert notes(first, second) == (
        *equations,
        "Fixed, not estimated, in fit 1 of these: X_p = 0, X_q = 0.1.",
        "Fixed, not estimated, in fit 2 of these: X_p = 0, X_q = 0.2.",
    )


@pytest.mark.parametrize(
    ("names", "title"), [(("a.csv",), "a.csv"), (("a.csv", "b.csv", "c.csv"), "a.csv and 2 more")]
)
def test_a_pages_title_tells_that_there_are_more_files(tmp_path: Path, names: tuple[str, ...], title: str) -> None:
    sources = tuple(Source(name, "0") for name in (*names, "map.toml"))
    write_tables_report(tmp_path / "page.html", sources, TableIdentification(names, (), (), (), None))
    assert f"<title>{title}: identification</title>" in (tmp_path / "page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("known", [True, False])
def test_modes_of_which_none_was_identified_have_no_heads_of_columns(known: bool) -> None:
    refused = nothing("spectrum", "a frequency response needs 4 records or more")
    frequency = estimate("short_period_frequency", "rad/s", 2.5, 0.1)
    found = Oscillation(frequency, estimate("short_period_damping", "-", 0.5, 0.1), None, None, None, ())
    modes = (*((Mode("output error", found, None, (), (), ()),) if known else ()), refused)
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(
        identification_table(Identification(modes=ModesResult(modes, None, "no comparison", None, 1, None)))
    )
    text = console.export_text()
    assert "needs 4 records or more" in text and ("95 % interval" in text) is known


def printed(what: RenderableType) -> list[str]:
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(what)
    return [line.rstrip() for line in console.export_text().splitlines() if line.strip()]


def test_a_reason_that_several_methods_have_is_told_once() -> None:
    both = ("short_period", "phugoid")
    modes = (
        nothing("output error", "gusts", both), nothing("free response", "gusts", both),
        nothing("spectrum", "gusts"), nothing("realization", "no input"),
    )  # fmt: skip
    assert printed(
        identification_table(Identification(modes=ModesResult(modes, *agreement(modes), None, 1, None)))
    ) == [
        "output error; free response short period, phugoid; spectrum short period: not identified: gusts",
        "realization short period: not identified: no input",
        "modes agreement: no comparison: no method gives a number",
    ]


def test_why_a_table_gives_no_modes_by_a_fit_stands_at_the_fit() -> None:
    why = "the search ran into a bound"
    lost = tuple(Finding("no_effect", "withheld", name) for name in ("Z_delta", "M_delta"))
    failed = Finding("no_numbers", "withheld", details={"reason": why})
    fit = EstimationResult(
        "output_error", "modes", status="not converged", findings=(failed, *lost), title="output error, short period"
    )
    modes = (nothing("output error", why), nothing("spectrum", "no input"))
    result = ModesResult(modes, *agreement(modes), None, 1, None)
    found = TableIdentification(("t.csv",), ("one",), (), (fit,), result)
    assert printed(table_identification(found)) == [
        "fitted: one",
        "output error, short period: no numbers",
        why,
        "Z_delta, M_delta not identified: it has no effect on the fitted outputs",
        "output error short period: not identified: as said above",
        "spectrum short period: not identified: no input",
        "modes agreement: no comparison: no method gives a number",
    ]
    (refused,) = table_document(found)["modes"]["methods"][0]["unidentified"]
    assert refused["reason"] == why


def test_the_model_of_a_table_is_the_truth_with_its_nose_up_elevator(
    files: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(files, "--model", str(tmp_path / "bird.toml")) == 0
    expected = capsys.readouterr().out
    assert "delta_e pitches the nose down: the model's elevator is -delta_e" in expected
    assert "fixed, not estimated: X_q = 0, X_delta = 0, Z_q = 0" in expected
    assert re.search(r"wingbeat tune \S*bird\.toml needs --vehicle V too", expected)
    model = load_model(tmp_path / "bird.toml")
    truth = matrices(tuple(TRUTH), np.array(list(TRUTH.values())), about(), Aircraft())
    assert (model.airspeed, model.pitch, model.frequency) == (SPEED, PITCH, 4.0)
    np.testing.assert_allclose(model.a, truth.a, rtol=0.05, atol=0.05)
    np.testing.assert_allclose(model.elevator, -truth.b, rtol=0.05)
    found = model.from_log()
    assert found.sha256 == hashlib.sha256(files[0].read_bytes()).hexdigest()
    assert found.angle_of_attack == ALPHA and found.density == 1.2
    assert found.elevator == pytest.approx(ELEVATOR, abs=1e-6)
    signs = {name: -1.0 if name.endswith("delta") else 1.0 for name in TRUTH}
    inside = [one.low <= signs[one.name] * TRUTH[one.name] <= one.high for one in found.values if one.name in TRUTH]
    assert len(inside) == 9 and sum(inside) >= 8


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('model = "longitudinal"', 'model = "none"', r"of a fit with model = \"longitudinal\""),
        ("theta = 0.15\n", "", r"the trim is not known: the map lacks constants.theta \(map"),
        ("flapping = 4.0\n", "", r"the map lacks constants.flapping"),
        ("V = 8.0\n", "", r"the map lacks constants.V or signals.V"),
        ('M_u = "free"\n', "", r"parameters lacks M_u"),
        ('inputs = ["delta_e"]', "inputs = []", r"one elevator in inputs, not 0"),
    ],
)
def test_what_a_model_lacks_is_told_before_the_table_is_read(
    files: tuple[Path, Path], tmp_path: Path, old: str, new: str, expected: str
) -> None:
    files[0].unlink()
    assert old in MAP
    files[1].write_text(MAP.replace(old, new))
    with pytest.raises(InputError, match=expected):
        run(files, "--model", str(tmp_path / "bird.toml"))
    assert not (tmp_path / "bird.toml").exists()


@pytest.mark.parametrize("option", ["--report", "--model"])
def test_an_existing_file_is_refused_before_the_table_is_read(
    files: tuple[Path, Path], tmp_path: Path, option: str
) -> None:
    files[0].unlink()
    mine = tmp_path / "mine.toml"
    mine.write_text("mine")
    with pytest.raises(InputError, match=r"mine.toml exists: it is not overwritten$"):
        run(files, option, str(mine))
    assert mine.read_text() == "mine"


def test_a_model_that_was_not_identified_is_not_written(files: tuple[Path, Path], tmp_path: Path) -> None:
    lines = files[0].read_text().splitlines()
    still = [f"{row.rpartition(',')[0]},0.05" for row in lines[1:]]
    files[0].write_text("\n".join((lines[0], *still)) + "\n")
    with pytest.raises(InputError, match=r"^modes: delta_e does not move"):
        run(files, "--model", str(tmp_path / "bird.toml"))
    assert not (tmp_path / "bird.toml").exists()


def test_names_of_signals_and_coefficients_are_set_as_symbols() -> None:
    assert symbol("C_m_alpha") == "<i>C</i><sub>mα</sub>"
    assert symbol("delta_e") == "<i>δ</i><sub>e</sub>"
    assert symbol("q_dot") == "<i>q\u0307</i>"
    assert (
        rich("regression of C_m by alpha of alpha.csv")
        == "regression of <i>C</i><sub>m</sub> by <i>α</i> of alpha.csv"
    )
    assert sentence("it ended") == "It ended." and sentence("C_m is told.") == "C_m is told."
