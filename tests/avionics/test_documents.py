"""TOML and JSON of users: every failure of a parser is one line, wherever a file is read."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from avionics.inputs import decode_command
from avionics.link.key_file import KeyFile
from avionics.missions.plan_file import read as read_plan
from avionics.missions.reader import load_plan
from avionics.snapshot import decode
from avionics.state import AutopilotState
from avionics.vehicles.loader import load_vehicle as load_flight_vehicle
from logs.campaigns.campaign import load_campaign
from logs.importing.mapping import load_mapping
from sim_bridge.flight.faults import mission_faults
from sim_bridge.tuning.model import load_model
from sim_bridge.vehicles import load_vehicle
from wingbeat.documents import parse_json, parse_toml
from wingbeat.errors import DocumentError, InputError
from wingbeat.schema import read_document

DEEP, LONG = "[" * 5000 + "]" * 5000, "9" * 5000
HOSTILE_TOML = [f"x = {DEEP}\n", f"x = {LONG}\n", f"x = {'9' * 25}\n", "x = \n", "x = [[[[\n"]
HOSTILE_JSON = [DEEP, LONG, "9" * 25, '{"x": ' * 5000 + "1" + "}" * 5000, '{"x": ', ""]


@pytest.mark.parametrize("text", HOSTILE_TOML)
def test_toml_that_cannot_be_parsed_is_one_line(text: str) -> None:
    with pytest.raises(DocumentError) as failure:
        parse_toml(text)
    assert str(failure.value).startswith("not valid TOML: ") and "\n" not in str(failure.value)
    assert len(str(failure.value)) < 200


@pytest.mark.parametrize("text", HOSTILE_JSON)
def test_json_that_cannot_be_parsed_is_one_line(text: str) -> None:
    with pytest.raises(DocumentError) as failure:
        parse_json(text)
    assert str(failure.value).startswith("not valid JSON: ") and "\n" not in str(failure.value)


def test_integers_of_64_bits_are_parsed_exactly() -> None:
    assert parse_json(f"[{2**64 - 1}, {-(2**63)}]") == [2**64 - 1, -(2**63)]
    assert parse_toml(f"x = [{2**63 - 1}, true, 1e300]") == {"x": [2**63 - 1, True, 1e300]}


TOML_READERS: dict[str, Callable[[Path], Any]] = {
    "mission": load_plan,
    "faults": mission_faults,
    "flight vehicle": load_flight_vehicle,
    "vehicle": lambda path: load_vehicle(str(path)),
    "campaign": load_campaign,
    "map": lambda path: read_document(path, "map"),
    "mapping": load_mapping,
    "model": load_model,
}


@pytest.mark.parametrize("reader", TOML_READERS.values(), ids=TOML_READERS)
@pytest.mark.parametrize("text", HOSTILE_TOML[:3])
def test_every_toml_reader_names_the_file(tmp_path: Path, reader: Callable[[Path], Any], text: str) -> None:
    path = tmp_path / "file.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"file\.toml"):
        reader(path)


@pytest.mark.parametrize("text", HOSTILE_JSON)
def test_every_json_reader_refuses_in_one_line(tmp_path: Path, text: str) -> None:
    plan, key = tmp_path / "file.plan", tmp_path / "key"
    plan.write_text(text)
    with pytest.raises(InputError, match=r"file\.plan"):
        read_plan(plan)
    with pytest.raises(InputError, match="not a snapshot"):
        decode(AutopilotState, text)
    with pytest.raises((ValueError, KeyError, TypeError)):
        decode_command(text)
    (tmp_path / "key.stamps").write_text(text)
    with pytest.raises(InputError, match=r"key\.stamps"):
        KeyFile(key).load_stamps()


STAMPS: list[Any] = [
    [],
    {},
    {"ours": 1},
    {"ours": 1, "streams": 5},
    {"ours": 1, "streams": [[1, 2, 3]]},
    {"ours": "x", "streams": []},
    {"ours": float("inf"), "streams": []},
    {"ours": None, "streams": []},
    {"ours": 1, "streams": [[1, 2, 3, float("nan")]]},
]


@pytest.mark.parametrize("document", STAMPS)
def test_damaged_stamps_are_refused_in_one_line(tmp_path: Path, document: Any) -> None:
    (tmp_path / "key.stamps").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"key\.stamps"):
        KeyFile(tmp_path / "key").load_stamps()


def test_stamps_that_are_a_folder_or_bytes_are_refused(tmp_path: Path) -> None:
    stamps = tmp_path / "key.stamps"
    stamps.write_bytes(os.urandom(64) + b"\xff")
    with pytest.raises(InputError, match=r"key\.stamps"):
        KeyFile(tmp_path / "key").load_stamps()
    stamps.unlink()
    stamps.mkdir()
    with pytest.raises(InputError, match=r"key\.stamps"):
        KeyFile(tmp_path / "key").load_stamps()
