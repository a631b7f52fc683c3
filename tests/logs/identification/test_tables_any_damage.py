"""Tables and maps broken anywhere: identified, or refused in one line; never a traceback or a warning."""

from __future__ import annotations

import json
import random
import warnings
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_tables_identified import BASE, flight, write

from logs.identification.report.tables import notes_of, table_document
from logs.identification.sources.table.columns import Layout, read_columns
from logs.identification.sources.table.config import example_map, load_map
from logs.identification.sources.table.run import identify_tables
from wingbeat.errors import InputError

MAP = (
    BASE
    + """
[[aero.regressions]]
response = "q_dot"
regressors = ["alpha", "q", "delta_e"]
selection = "stepwise"
[maneuvers]
windows = [[0, 8], [8, 14.9]]
validate = [2]
"""
)
TOKENS = (
    "",
    "NaN",
    "-1e308",
    "1e999",
    "0",
    "nan",
    "-9999",
    "x",
    '"',
    ",",
    ";",
    "\t",
    "\n",
    "[",
    "{",
    "true",
    "1.0D+02",
)


def refused(work: object) -> str:
    """What it was refused with; nothing where it was done. Warnings are errors."""
    assert callable(work)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            work()
        except InputError as error:
            assert str(error).isprintable() and len(str(error)) < 3000
            return str(error)
    return ""


def attempt(folder: Path, table: bytes, mapping: str) -> str:
    (folder / "run.csv").write_bytes(table)
    (folder / "map.toml").write_text(mapping, encoding="utf-8", errors="surrogateescape")

    def work() -> None:
        found = identify_tables([folder / "run.csv"], folder / "map.toml")
        json.dumps(table_document(found), allow_nan=False)
        for fit in found.fits:
            assert all(line.isprintable() for line in notes_of(fit))
            assert all(np.isfinite([one.value, one.low, one.high]).all() for one in fit.estimates)

    return refused(work)


def whole_table(folder: Path) -> bytes:
    return write(folder / "whole.csv", {name: values[:375:3] for name, values in flight().items()}).read_bytes()


def damaged(whole: bytes, seed: int) -> bytes:
    """Cut off, or with lines, cells or bytes put in, changed, repeated or taken out."""
    source = random.Random(seed)
    lines = whole.split(b"\n")
    for _ in range(source.randint(1, 4)):
        kind, at = source.randrange(7), source.randrange(1, len(lines))
        if kind == 0:
            lines = lines[:at]
        elif kind == 1:
            lines[at:at] = [source.choice(TOKENS).encode()]
        elif kind == 2:
            cells = lines[at].split(b",")
            cells[source.randrange(len(cells))] = source.choice(TOKENS).encode()
            lines[at] = b",".join(cells)
        elif kind == 3:
            lines[at:at] = lines[max(0, at - 30) : at]
        elif kind == 4:
            place = source.randrange(5)
            value = source.choice(TOKENS).encode()
            lines[1:] = [
                b",".join(value if n == place else c for n, c in enumerate(x.split(b","))) for x in lines[1:]
            ]
        elif kind == 5:
            lines[at] = bytes(source.randrange(256) for _ in range(20))
        else:
            del lines[at : at + source.randint(1, 60)]
        lines = lines if len(lines) > 1 else [*lines, b""]
    return b"\n".join(lines)


def test_the_whole_table_is_identified(tmp_path: Path) -> None:
    assert attempt(tmp_path, whole_table(tmp_path), MAP) == ""


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_table(tmp_path: Path, seed: int) -> None:
    attempt(tmp_path, damaged(whole_table(tmp_path), seed), MAP)


@pytest.mark.validate
def test_a_thousand_damaged_tables(tmp_path: Path) -> None:
    whole = whole_table(tmp_path)
    told = [attempt(tmp_path, damaged(whole, seed), MAP) for seed in range(1000)]
    assert 0 < sum(map(bool, told)) < len(told)


def damaged_map(seed: int) -> str:
    source = random.Random(seed)
    text = MAP if seed % 2 else example_map("modes")
    for _ in range(source.randint(1, 3)):
        at = source.randrange(len(text))
        kind = source.randrange(4)
        if kind == 0:
            text = text[:at] + source.choice(TOKENS) + text[at:]
        elif kind == 1:
            text = text[:at] + text[at + source.randint(1, 8) :]
        elif kind == 2:
            words = text.split(" ")
            words[source.randrange(len(words))] = source.choice((*TOKENS, "-1", "[]", "{}", '"V"', "0.0", "1e30"))
            text = " ".join(words)
        else:
            lines = text.split("\n")
            lines.insert(source.randrange(len(lines)), source.choice(lines))
            text = "\n".join(lines)
    return text


@pytest.mark.parametrize("seed", range(40))
def test_a_damaged_map(tmp_path: Path, seed: int) -> None:
    (tmp_path / "map.toml").write_text(damaged_map(seed))
    if not refused(lambda: load_map(tmp_path / "map.toml")) and seed % 8 == 1:
        attempt(tmp_path, whole_table(tmp_path), damaged_map(seed))


@pytest.mark.validate
def test_five_hundred_damaged_maps(tmp_path: Path) -> None:
    whole = whole_table(tmp_path)
    told = [attempt(tmp_path, whole, damaged_map(seed)) for seed in range(500)]
    assert 0 < sum(map(bool, told)) < len(told)


CELLS = st.one_of(
    st.floats(allow_nan=True, allow_infinity=True).map(repr), st.text(max_size=6), st.sampled_from(TOKENS)
)


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(st.lists(CELLS, max_size=5), max_size=12),
    delimiter=st.sampled_from((",", ";", "\t", " ", "|")),
    layout=st.builds(
        Layout,
        delimiter=st.sampled_from((None, ",", ";", "whitespace", "", "ab", "\n")),
        decimal=st.sampled_from((None, ".", ",")),
        names=st.sampled_from((None, True, False)),
        skip=st.sampled_from((None, 0, 1, 100, -1)),
        encoding=st.sampled_from(("utf-8", "latin-1", "klingon")),
    ),
)
def test_any_cells_are_read_or_refused(tmp_path: Path, rows: list[list[str]], delimiter: str, layout: Layout) -> None:
    path = tmp_path / "any.csv"
    path.write_text("\n".join(delimiter.join(row) for row in rows), encoding="utf-8", errors="surrogatepass")
    refused(lambda: read_columns(path, layout))
