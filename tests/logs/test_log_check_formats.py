"""Planted faults in drawn logs of PX4, ArduPilot, tables and Wingbeat."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from drawn_logs import FORMATS, Fault, Format, begin, drawn_flight, planted
from foreign_logs import Tables

from logs.checks.findings import Finding
from logs.checks.run import check_log


def findings(kind: Format, tables: Tables, folder: Path) -> list[Finding]:
    """Write, check and remove one log."""
    paths = kind.write(tables, folder)
    found = [one for one in check_log(paths).findings if one.severity != "info"]
    for path in paths:
        path.unlink()
    return found


def is_reported(kind: Format, fault: Fault, at: float, tables: Tables, reported: list[Finding]) -> bool:
    """Whether a finding has code, topic and, of a local fault, the time within 0.5 s."""
    topic = kind.names.get(fault.topic, fault.topic)
    match = [one for one in reported if (one.code, one.topic) == (fault.code, topic)]
    near = [one for one in match if abs(one.start - (at - begin(tables))) <= 0.5]
    return bool(near if fault.is_local else match)


@pytest.fixture(scope="module")
def flight() -> Tables:
    return drawn_flight(3)


# Faults in the topics of PX4 are in `test_log_check` too.
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.validate if name == "px4" else ()) for name in FORMATS]
)
def test_faults_in_a_drawn_log_of_each_format(name: str, flight: Tables, tmp_path: Path) -> None:
    """GIVEN one drawn log of a format WHEN a few faults are planted THEN each is found, and none in the clean log."""
    kind = FORMATS[name]
    assert findings(kind, flight, tmp_path) == []
    first = list(FORMATS).index(name)
    for fault in kind.faults[first :: len(FORMATS)]:
        tables = planted(flight, fault, 26.4)
        assert is_reported(kind, fault, 26.4, tables, findings(kind, tables, tmp_path)), fault.code


@pytest.mark.validate
@pytest.mark.parametrize("name", FORMATS)
def test_planted_faults_in_ten_drawn_logs(name: str, tmp_path: Path) -> None:
    """GIVEN ten drawn logs WHEN twelve faults are planted THEN 11 of 12 are found, and one false alarm at most."""
    kind, missed, alarms = FORMATS[name], list[str](), list[str]()
    for seed in range(10):
        flight = drawn_flight(seed)
        alarms += [f"{seed} {one.code} {one.text}" for one in findings(kind, flight, tmp_path)]
        for number, fault in enumerate(kind.faults):
            at = float(np.random.default_rng((seed, number)).uniform(18.0, 36.0))
            tables = planted(flight, fault, at)
            found = findings(kind, tables, tmp_path)
            if not is_reported(kind, fault, at, tables, found):
                missed.append(f"{seed} {fault.code} at {at - begin(tables):.1f}: {[one[:4] for one in found]}")
    print(f"\n{name}: {120 - len(missed)} of 120; missed {missed}; alarms {alarms}")  # noqa: T201
    for fault in kind.faults:
        assert sum(fault.code in one for one in missed) <= 10
    assert 120 - len(missed) >= 110
    assert len(alarms) <= 1
