"""Tables read by type hints: every error is one line that names key, value and what is allowed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, NamedTuple

import pytest

from wingbeat.errors import InputError
from wingbeat.schema import error_context, read_document, read_record
from wingbeat.units import ABOVE_ZERO, Quantity


class Wing(NamedTuple):
    span: Annotated[float, Quantity("m", 0.1, 3.0)]
    strips: Annotated[int, Quantity("-", 1)] = 8
    mass: Annotated[float, Quantity("kg", ABOVE_ZERO)] = 0.1
    center: Annotated[tuple[float, float], Quantity("m", -1.0, 1.0)] = (0.0, 0.0)
    shape: Annotated[str, "swept tip", "ellipse"] = "ellipse"
    free: bool = False


class Aircraft(NamedTuple):
    wings: dict[str, Wing]
    rows: tuple[tuple[float, float], ...] = ()
    note: str | None = None


def test_read_record_by_type_hints() -> None:
    table = {
        "wings": {"left": {"span": 1, "strips": 4.0, "shape": "swept-tip", "center": [0, 0.5]}},
        "rows": [[1, 2]],
    }
    left = Wing(1.0, 4, 0.1, (0.0, 0.5), "swept tip")
    assert read_record(Aircraft, table) == Aircraft({"left": left}, ((1.0, 2.0),))


@pytest.mark.parametrize(
    ("wing", "problem"),
    [
        ({}, "wings.left.span is missing (0.1 to 3 m)"),
        ({"span": 4}, "wings.left.span = 4 is outside 0.1 to 3 m"),
        ({"span": "1 m"}, "wings.left.span must be a number (0.1 to 3 m), not '1 m'"),
        ({"span": True}, "wings.left.span must be a number (0.1 to 3 m), not True"),
        ({"span": float("nan")}, "wings.left.span must be a finite number (0.1 to 3 m), not nan"),
        ({"span": 1, "spam": 1}, "unknown key wings.left.spam (meant 'span'?); known: span, strips"),
        ({"span": 1, "strips": 1.5}, "wings.left.strips must be a whole number (1 or more), not 1.5"),
        ({"span": 1, "strips": 0}, "wings.left.strips = 0 must be 1 or more"),
        ({"span": 1, "mass": 0}, "wings.left.mass = 0 must be above 0 kg"),
        ({"span": 1, "center": [0]}, "wings.left.center must be a list of 2 numbers (-1 to 1 m), not [0]"),
        ({"span": 1, "center": [0, 2]}, "wings.left.center[1] = 2 is outside -1 to 1 m"),
        ({"span": 1, "shape": "box"}, "wings.left.shape = 'box' is not known; known: swept tip, ellipse"),
        ({"span": 1, "free": 1}, "wings.left.free must be true or false, not 1"),
        (3, "wings.left must be a section of keys, not 3"),
    ],
)
def test_read_record_errors(wing: Any, problem: str) -> None:
    with pytest.raises(InputError) as caught, error_context("a.toml"), error_context("item 2"):
        read_record(Aircraft, {"wings": {"left": wing}})
    assert str(caught.value).startswith(f"a.toml: item 2: {problem}")


def test_read_record_errors_of_lists_and_text() -> None:
    with pytest.raises(InputError, match=r"^rows\[0\] must be a list of 2 numbers, not \[1\]$"):
        read_record(Aircraft, {"wings": {}, "rows": [[1]]})
    with pytest.raises(InputError, match=r"^note = 'a.x1bb' has characters that cannot be printed$"):
        read_record(Aircraft, {"wings": {}, "note": "a\x1bb"})


def test_read_document_of_both_languages(tmp_path: Path) -> None:
    toml, json, array = tmp_path / "a.toml", tmp_path / "a.json", tmp_path / "b.json"
    toml.write_text("\ufeffx = 1\n", encoding="utf-8")
    json.write_text('{"x": 1}')
    array.write_text("[1]")
    assert read_document(toml, "map") == read_document(json, "map") == {"x": 1}
    with pytest.raises(InputError, match=r"b\.json: the map must be a section of keys, not \[1\]$"):
        read_document(array, "map")
    with pytest.raises(InputError, match=r"cannot read map .*none\.toml: there is no such file"):
        read_document(tmp_path / "none.toml", "map")
