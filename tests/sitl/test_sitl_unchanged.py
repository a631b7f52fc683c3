"""The flight of the default vehicle and seed is that of the version before, bit for bit.

`tests/data/flight_columns.json` has a digest of every recorded column. After a change that is meant to alter flights,
write it anew: ``python tests/sitl/test_sitl_unchanged.py`` in the folder of the project.
"""

from __future__ import annotations

import hashlib
import json
import platform
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
import numpy as np
import pytest
from simulate import DETERMINISTIC, RAVEN, simulate

from sim_bridge.flight.world import Scenario
from wingbeat.message import Event, Text

DIGESTS = Path(__file__).parents[1] / "data" / "flight_columns.json"
DURATIONS = {"30 s": 30.0, "whole": 300.0}


def machine() -> dict[str, str]:
    """What the last bit of a compiled number depends on."""
    return {
        "machine": platform.machine(),
        "cpu": llvmlite.binding.get_host_cpu_name(),
        "libc": " ".join(platform.libc_ver()),
        "numba": numba.__version__,
        "numpy": np.__version__,
    }


def digest(column: tuple[Any, ...]) -> str:
    plain = [int(value) if isinstance(value, Enum) else value for value in column]
    return hashlib.sha256(repr(plain).encode()).hexdigest()[:16]


@cache
def columns(duration: float) -> dict[str, Any]:
    """Number of messages and digests of the columns, by topic, in the order of the fields."""
    flight = simulate(RAVEN, Scenario(seed=1, duration=duration))
    found = {topic.name: flight.of(topic) for topic in DETERMINISTIC if topic.message not in (Event, Text)}
    return {
        name: {
            "messages": len(messages),
            "columns": {
                field: digest(column)
                for field, column in zip(messages[0]._fields, zip(*messages, strict=True), strict=True)
            },
        }
        for name, messages in found.items()
        if messages
    }


def changed(before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Names of topics and columns that differ; fields may have other names, not another order."""
    different = sorted(set(before) ^ set(now))
    for name in sorted(set(before) & set(now)):
        if before[name]["messages"] != now[name]["messages"]:
            different.append(f"{name}: number of messages")
        old, new = (list(each[name]["columns"].items()) for each in (before, now))
        different += [f"{name}.{field}" for (_, a), (field, b) in zip(old, new, strict=False) if a != b]
        different += [f"{name}.{field} is missing" for field, _ in old[len(new) :]]
    return different


@pytest.mark.parametrize("flight", ["30 s", pytest.param("whole", marks=pytest.mark.validate)])
def test_flight_is_bitwise_unchanged(flight: str) -> None:
    """GIVEN the digests of a recorded flight WHEN it is flown again THEN every column is the same bit for bit."""
    document = json.loads(DIGESTS.read_text())
    if document["machine"] != machine():
        pytest.skip(f"the digests were made on another machine: {document['machine']}")
    now = columns(DURATIONS[flight])
    assert len(now) > 15
    assert changed(document[flight], now) == []


def test_changed_names_the_column_that_differs() -> None:
    before = {"/a": {"messages": 2, "columns": {"x": "1", "y": "2"}}, "/b": {"messages": 1, "columns": {}}}
    assert (
        changed(before, {"/a": {"messages": 2, "columns": {"z": "1", "y": "2", "new": "3"}}} | {"/b": before["/b"]})
        == []
    )
    assert changed(before, {"/a": {"messages": 3, "columns": {"x": "1", "y": "3"}}}) == [
        "/b",
        "/a: number of messages",
        "/a.y",
    ]
    assert changed(before, before | {"/a": {"messages": 2, "columns": {"x": "1"}}}) == ["/a.y is missing"]


if __name__ == "__main__":
    document = {"machine": machine()} | {flight: columns(duration) for flight, duration in DURATIONS.items()}
    DIGESTS.write_text(json.dumps(document, indent=1) + "\n")
