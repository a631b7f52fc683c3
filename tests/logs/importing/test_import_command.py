"""``wingbeat log import`` as a person and a program use it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import DATA, new_dataflash

from groundstation.command.main import main
from logs.importing import checks
from logs.reader import open_log

Capture = pytest.CaptureFixture[str]


@pytest.fixture
def source(tmp_path: Path) -> Path:
    """A dataflash log with a row that cannot be true."""
    log = new_dataflash()
    log.write("ATT", 4_990_000, 0, 9500, 0)
    path = tmp_path / "00000007.bin"
    path.write_bytes(log.data)
    return path


def test_what_came_of_it_is_told_to_people(source: Path, capsys: Capture) -> None:
    assert main(["log", "import", str(source)]) == 0
    said = capsys.readouterr().out
    assert "ArduPlane V4.5.7" in said and str(source.with_suffix(".mcap")) in said.replace("\n", "")
    assert "dropped: 1 row of /attitude/ahrs: pitch out of range" in said
    assert main(["log", "info", str(source.with_suffix(".mcap")), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["vehicle"].startswith("ArduPlane")


def test_what_came_of_it_is_told_to_programs(source: Path, tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "new" / "flight.mcap"
    assert main(["log", "import", str(source), "--to", str(out), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["file"] == str(out) and told["format"] == "ArduPilot dataflash"
    assert told["dropped"] == [{"topic": "/attitude/ahrs", "reason": "pitch out of range", "rows": 1}]
    with open_log(out) as log:
        counts = {name: info.messages for name, info in log.topics.items()}
    assert {row["topic"]: row["messages"] for row in told["topics"]}.items() <= counts.items()
    assert {"/view/estimated/transforms", "/view/estimated/scene"} < counts.keys()
    assert told["messages"] + told["events"] == sum(counts.values())


def test_the_same_source_gives_the_same_file(source: Path, tmp_path: Path) -> None:
    outs = [tmp_path / name for name in ("a.mcap", "b.mcap")]
    for out in outs:
        assert main(["log", "import", str(source), "--to", str(out)]) == 0
    assert outs[0].read_bytes() == outs[1].read_bytes()


@pytest.mark.parametrize(
    ("content", "name", "reason"),
    [
        (b"\xa3\x95\x80 damaged", "x.bin", "no whole record"),
        (b"", "x.ulg", "empty"),
        (b"words", "x.txt", "unknown log format"),
        (b"t,x\n1,2\n", "x.csv", "needs --map"),
    ],
)
def test_bad_input_is_one_line_and_code_2_and_nothing_is_written(
    tmp_path: Path, capsys: Capture, content: bytes, name: str, reason: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    assert main(["log", "import", str(path)]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and reason in said.err
    assert list(tmp_path.iterdir()) == [path]


def test_no_file_is_overwritten(source: Path, tmp_path: Path, capsys: Capture) -> None:
    out = tmp_path / "precious.mcap"
    out.write_bytes(b"precious")
    assert main(["log", "import", str(source), "--to", str(out)]) == 2
    assert "exists" in capsys.readouterr().err and out.read_bytes() == b"precious"
    assert main(["log", "import", str(tmp_path / "missing.bin")]) == 2


def test_a_mapping_for_what_is_no_table_is_refused(source: Path, capsys: Capture) -> None:
    mapping = str(DATA / "fixedwing_model.toml")
    assert main(["log", "import", str(source), "--map", mapping]) == 2
    assert "--map" in capsys.readouterr().err


# --- which rows can be true -------------------------------------------------------------------------------


def test_one_false_stamp_costs_one_row_wherever_it_points() -> None:
    for false in (0, 10**12):
        times = np.arange(100, 200)
        times[40] = false
        mask = checks.monotonic_rows(times)
        assert mask.sum() == 99 and not mask[40]


def test_rows_out_of_order_are_kept_and_false_stamps_are_not() -> None:
    """GIVEN neighbors exchanged, and one stamp elsewhere WHEN looked at THEN only that one is dropped."""
    times = np.arange(0, 100_000_000, 100_000)
    exchanged = times.reshape(-1, 2)[:, ::-1].ravel()
    assert checks.nearly_ordered(exchanged).all()
    exchanged[500] = 3_000
    mask = checks.nearly_ordered(exchanged)
    assert mask.sum() == len(times) - 1 and not mask[500]


def test_rows_are_kept_whose_times_stand_still() -> None:
    assert checks.monotonic_rows(np.array([5, 5, 5, 6])).all() and checks.monotonic_rows(np.array([], np.int64)).all()


def test_the_longer_side_of_a_long_pause_is_kept() -> None:
    times = np.array([0, 1, 2, 3, 10**11, 10**11 + 1], np.int64)
    assert checks.together(times).tolist() == [True] * 4 + [False] * 2


def test_a_value_that_is_not_known_may_stand_and_one_that_cannot_be_may_not() -> None:
    values = np.array([np.nan, 0.0, 181_280.0, np.inf])
    assert checks.possible(values, "deg").tolist() == [True, True, False, False]
    assert checks.possible(np.array([1e30, np.inf, np.nan]), "").tolist() == [False, True, True]
