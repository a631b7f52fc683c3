"""``wingbeat validate``: the table, for people and for programs."""

from __future__ import annotations

import io
import json
from contextlib import nullcontext
from pathlib import Path

import numba
import numpy as np
import pytest
from rich.console import Console

from groundstation.command import validate
from groundstation.command.compiling import COMPILING_METHODS, announced
from groundstation.command.main import main
from groundstation.views.validation import validation_table
from logs.reader import open_log
from sim_bridge.aerodynamics.vortex_lattice.unsteady import Snapshot
from sim_bridge.validation.papers import PAPERS
from sim_bridge.validation.row import OUTCOMES, Check, Row, Study
from sim_bridge.validation.yeo_lattice import wing

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def unreported(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is said on stderr does not hang on what the cache of kernels has."""
    monkeypatch.setattr(validate, "announced", lambda quiet, live: nullcontext())


@pytest.mark.parametrize(("words", "reports"), [([], f"{COMPILING_METHODS}\n"), (["--json"], "")])
def test_a_compilation_is_announced_once_and_not_to_programs(
    words: list[str], reports: str, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels = [numba.njit(lambda x: x + 1), numba.njit(lambda x: x + 2)]

    def rows() -> list[Row]:
        assert [kernel(1) for kernel in kernels] == [2, 3]
        return []

    check = Check("compiled", rows)
    monkeypatch.setattr(validate, "announced", announced)
    monkeypatch.setitem(PAPERS, "sibilski", PAPERS["sibilski"]._replace(checks=(check,)))
    assert main(["validate", "--only", "sibilski", *words]) == 0
    assert capsys.readouterr().err == reports


def test_one_paper_is_told_to_people(capsys: Capture) -> None:
    assert main(["validate", "--only", "yeo"]) == 0
    reports = capsys.readouterr()
    assert reports.err == ""
    assert "Yeo, Atkins, Shyy 2011" in reports.out and "Gerdes" not in reports.out
    assert "within 5 %" in reports.out and "falls short of" in reports.out and "4 figures: within 3" in reports.out


def test_one_paper_is_told_to_programs(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    quick = tuple(check for check in PAPERS["gerdes"].checks if not check.slow)
    monkeypatch.setitem(PAPERS, "gerdes", PAPERS["gerdes"]._replace(checks=quick))
    assert main(["validate", "--only", "gerdes", "--json"]) == 0
    stated = json.loads(capsys.readouterr().out)
    assert set(stated) | {"rows"} == set(validate.JSON_KEYS)
    assert [one["paper"] for one in stated["left_out"]] == ["gerdes"]
    (paper,) = stated["papers"]
    assert paper["name"] == "gerdes" and paper["title"] == PAPERS["gerdes"].title
    assert sum(stated["counts"].values()) == len(paper["rows"])
    assert set(stated["counts"]) == set(OUTCOMES)
    for row in paper["rows"]:
        assert all(key in validate.JSON_KEYS["rows"] for key in row)
        low, high = row["published"]
        if low is None:
            assert row["difference"] is None
        else:
            assert row["ours"] - row["difference"] == pytest.approx(min(max(row["ours"], low), high))


@pytest.mark.parametrize("columns", [80, 100, 160])
def test_the_table_says_every_verdict_and_note_at_any_width(columns: int) -> None:
    rows = [row for check in PAPERS["gerdes"].checks if not check.slow for row in check.rows()]
    console = Console(width=columns, record=True, file=io.StringIO())
    console.print(validation_table({"gerdes": rows}))
    stated = console.export_text()
    assert max(map(len, stated.splitlines())) <= columns and "…" not in stated
    whole = " ".join(stated.split())
    notes = list(dict.fromkeys(row.why for row in rows if row.why))
    for number, words in enumerate(notes, start=1):
        assert f"[{number}] {words}" in whole
    marked = whole.split(f"[1] {notes[0]}")[0]
    for number, words in enumerate(notes, start=1):
        assert marked.count(f"[{number}]") == sum(row.why == words for row in rows)


def test_what_is_not_printed_is_null(capsys: Capture) -> None:
    assert main(["validate", "--only", "sibilski", "--json"]) == 0
    (paper,) = json.loads(capsys.readouterr().out)["papers"]
    assert paper["rows"][0]["published"] == [None, None] and paper["rows"][0]["difference"] is None


def test_slow_rows_are_announced(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    slow = PAPERS["sibilski"].checks[0]._replace(slow=True)
    monkeypatch.setitem(PAPERS, "sibilski", PAPERS["sibilski"]._replace(checks=(slow,)))
    assert main(["validate", "--only", "sibilski"]) == 0
    assert capsys.readouterr().err == "sibilski: open loop, which takes a while\n"


def test_studies_are_named_and_computed_when_asked_for(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    check = PAPERS["sibilski"].checks[0]
    study = Study("the same at length", lambda stated: check.rows())
    monkeypatch.setitem(PAPERS, "sibilski", PAPERS["sibilski"]._replace(checks=(), studies=(study,)))
    assert main(["validate", "--only", "sibilski"]) == 0
    reports = capsys.readouterr()
    assert reports.err == "" and "0 figures" in reports.out
    assert "not computed, minutes: sibilski, the same at length (--studies)" in reports.out
    assert main(["validate", "--only", "sibilski", "--studies"]) == 0
    reports = capsys.readouterr()
    assert reports.err == "sibilski: the same at length, which takes minutes\n"
    assert f"{len(check.rows())} figures" in reports.out and "not computed" not in reports.out


def test_an_unknown_paper_is_one_line(capsys: Capture) -> None:
    assert main(["validate", "--only", "lilienthal"]) == 2
    reports = capsys.readouterr()
    assert reports.out == "" and "lilienthal" in reports.err and reports.err.count("\n") == 1


def test_the_polar_plots_are_drawn_once(tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(PAPERS, "grauer", PAPERS["grauer"]._replace(checks=()))
    words = ["validate", "--only", "grauer", "--json", "--plots", str(tmp_path / "new")]
    assert main(words) == 0
    (path,) = json.loads(capsys.readouterr().out)["plots"]
    assert Path(path).read_bytes().startswith(b"\x89PNG")
    assert main(words) == 2
    assert "exists: it is not overwritten" in capsys.readouterr().err


def test_a_paper_without_pictures_says_which_have_some(tmp_path: Path, capsys: Capture) -> None:
    assert main(["validate", "--only", "sibilski", "--plots", str(tmp_path)]) == 2
    reports = capsys.readouterr()
    assert reports.err.endswith("sibilski has no pictures; grauer and lattice have\n") and not reports.out
    assert list(tmp_path.iterdir()) == []


def test_the_wake_is_recorded_once_and_with_the_lattice_alone(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "wake.mcap"
    assert main(["validate", "--only", "sibilski", "--scene", str(path)]) == 2
    assert "sibilski has no scene; only lattice has one" in capsys.readouterr().err and not path.exists()
    monkeypatch.setitem(PAPERS, "lattice", PAPERS["lattice"]._replace(checks=()))
    begun = wing()._replace(nodes=wing().nodes + 1.0)
    blank = np.zeros((3, 1, 13)), np.zeros((0, 12))
    monkeypatch.setattr(
        validate, "wake_course", lambda every, stated: [Snapshot(0.0, begun.nodes, np.zeros(72), *blank)]
    )
    words = ["validate", "--only", "lattice", "--json", "--scene", str(path)]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["scene"] == str(path)
    with open_log(path) as log:
        assert log.topics["/view/wake"].messages == 1
    assert main(words) == 2
    assert "exists: it is not overwritten" in capsys.readouterr().err
