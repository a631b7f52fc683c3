"""The tables of all commands on narrow terminals: every name, unit and number is there whole."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.text import Text

from groundstation.command import campaign_report
from groundstation.command.main import main
from groundstation.views import tables, terminal
from logs.campaigns.metrics import METRICS
from logs.campaigns.table import OWN, About, Table

Capture = pytest.CaptureFixture[str]
DATA = Path(__file__).parents[1] / "data"
EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
RAVEN = str(DATA / "models" / "robo_raven_ii_d.toml")
COMMANDS = [
    ["vehicles"],
    ["vehicles", "robo_raven_ii_d"],
    ["validate", "--only", "azuma"],
    pytest.param(["validate", "--only", "gerdes"], marks=pytest.mark.validate),
    pytest.param(["tune", RAVEN, "--vehicle", "robo_raven_ii_d", "--no-fly"], marks=pytest.mark.validate),
    ["design", RAVEN, "--frequency-error", "2"],
    ["identify", str(EXAMPLES / "short_period.csv"), "--map", str(EXAMPLES / "short_period.toml")],
    ["campaign", "report", "made.parquet"],
    ["replay", "--imu", str(DATA / "broad")],
]
WIDTHS = [60, 80]


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[list[tuple[str, str]]]:
    """Every cell of every table with its column's kind, as they are added; a campaign's table to report on."""
    cells: list[tuple[str, str]] = []
    add_row = tables.PlainTable.add_row

    def recorded(self: tables.PlainTable, *row: str | Text) -> None:
        plain = (one.plain if isinstance(one, Text) else one for one in row)
        cells.extend((kind, cell) for (_, kind), cell in zip(self._columns, plain, strict=False))
        add_row(self, *row)

    monkeypatch.setattr(tables.PlainTable, "add_row", recorded)
    monkeypatch.setattr(campaign_report, "read_table", lambda path: campaign_table())
    monkeypatch.chdir(tmp_path)
    yield cells


def campaign_table() -> Table:
    """Thirty flights with a number for each metric."""
    flights = 30
    columns: dict[str, list[object]] = {
        name: [1234.5678 * (i + 1) for i in range(flights)] for name in (*METRICS, "scale.gains.pitch.damping")
    }
    columns |= {name: [""] * flights for name in OWN} | {"flight": list(range(flights)), "failed": [False] * flights}
    units = {name: metric.unit for name, metric in METRICS.items()}
    return Table(About("made", "up", "made.toml", "0", ("scale.gains.pitch.damping",)), columns, units)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: " ".join(Path(word).name for word in words))
def test_every_name_and_number_is_whole(
    words: list[str], width: int, shown: list[tuple[str, str]], capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(terminal, "UNBOUNDED", width)
    assert main(words) == 0
    told = capsys.readouterr().out
    lines = told.splitlines()
    assert not any(line.endswith(" ") for line in lines)
    kept = [(kind, cell) for kind, cell in shown if kind != tables.SPARE]
    assert len(kept) > 2 and "…" not in re.sub(r"\S+ … \S+", "", told)
    for kind, cell in kept:
        if kind in (tables.NUMBER, tables.UNIT):
            assert any(cell in line for line in lines), cell
        else:
            assert all(any(word in line for line in lines) for word in cell.split()), cell


@pytest.mark.parametrize("width", [24, 40, 60, 80, 120])
def test_no_line_is_longer_than_the_terminal_and_none_is_cut(width: int, capsys: Capture) -> None:
    table = tables.plain_table(
        ("method", tables.GROUP), ("name", tables.NAME), ("value", tables.NUMBER), ("95 % interval", tables.NUMBER),
        ("", tables.UNIT), ("source", tables.SENTENCES), ("also", tables.SPARE),
    )  # fmt: skip
    source = "measured on a stand, with words enough to fill more than a line of any terminal that is asked for here"
    table.add_row("equation error", "phugoid damping ratio", "-0.123", "-0.456 to 0.789", "s/rad", source, "left out")
    table.add_row("", "C_m_q", "12.5", "11 to 14", "rad/s", "", "")
    console = terminal.open_console()
    console.width = width
    console.print(table)
    told = capsys.readouterr().out
    assert max(map(len, told.splitlines())) <= width
    for whole in ("equation error", "-0.123", "-0.456 to 0.789", "s/rad", "C_m_q", "12.5", "11 to 14", "rad/s"):
        assert whole in told
    assert " ".join(source.split()) in " ".join(told.split()) or width == 120
    assert ("left out" in told) == (width > 200)


def test_what_fits_stands_on_a_line(capsys: Capture) -> None:
    table = tables.plain_table(("", ""), ("value", "right"), ("", "unit"), ("empty", "right"))
    table.add_row("span", "1.5", "m")
    table.add_row("mass of it", "0.359", "kg")
    terminal.open_console().print(table)
    assert capsys.readouterr().out.splitlines()[1:] == ["span           1.5   m", "mass of it   0.359   kg"]
