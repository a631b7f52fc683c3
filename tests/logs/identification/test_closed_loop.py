"""Control effectiveness from records in closed loop: consistent, and withheld with a weak instrument."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from closed_loop_flights import M_DELTA, MISSION, linear_flight, px4_tables

from groundstation.command.foreign_log import opened_log
from groundstation.command.identify import identified
from logs.identification.data.flight import Aircraft
from logs.identification.estimators.closed_loop import control_effectiveness, is_closed_loop
from logs.identification.estimators.flight_modes import consistent_result, identify_modes
from logs.identification.results import EstimationResult, estimate
from wingbeat.errors import InputError

sys.path.insert(0, str(Path(__file__).parents[1] / "importing"))

from foreign_logs import ulog

AIRCRAFT = Aircraft(tail_time_constant=0.0)


@pytest.mark.validate
def test_a_strong_instrument_covers_the_truth() -> None:
    """GIVEN closed loops in gusts with doublets of 6 degrees WHEN estimated THEN 95 % intervals hold the truth."""
    covered = []
    for seed in range(12):
        closed = control_effectiveness(linear_flight(0.10, 0.15, seed), AIRCRAFT)
        assert closed is not None and closed.finding.code == "closed_loop"
        value = closed.effectiveness
        assert value is not None and value.low > 0.0
        covered.append(value.contains(M_DELTA))
    assert sum(covered) >= 10


def test_a_weak_instrument_is_not_informative_and_the_planned_inputs_are_enough() -> None:
    """GIVEN doublets lost in the feedback WHEN estimated THEN none, and the inputs of the finding would do."""
    weak = control_effectiveness(linear_flight(0.002, 0.6, 1), AIRCRAFT)
    assert weak is not None and weak.effectiveness is None
    assert weak.finding.code == "not_informative" and weak.finding.value is not None and weak.finding.value < 10.0
    count, amplitude = weak.finding.details["count"], np.radians(weak.finding.details["amplitude"])
    assert 1 <= count <= 200
    flights = [linear_flight(float(amplitude), 0.6, seed, 4.0 * count + 4.0) for seed in range(3)]
    assert sum(one is not None and one.effectiveness is not None for one in map(_closed, flights)) >= 2


def _closed(flight: object) -> object:
    return control_effectiveness(flight, AIRCRAFT)  # type: ignore[arg-type]


def test_without_a_maneuver_the_setpoint_is_the_instrument() -> None:
    """GIVEN feedback alone and a setpoint at rest WHEN modes are identified THEN one finding instead of an error."""
    result = identify_modes(linear_flight(0.0, 0.3, 1), AIRCRAFT)
    (mode,) = result.modes
    assert mode.derivatives == () and mode.short_period is None
    (finding,) = (one for one in result.findings if one.severity == "withheld")
    assert (finding.code, finding.subject) == ("not_informative", "M_delta") and "doublets" in finding.text


def test_open_loop_is_left_alone() -> None:
    """GIVEN an elevator that is the excitation alone WHEN asked THEN it is no closed loop."""
    flight = linear_flight(0.1, 0.1, 1)
    opened = flight._replace(elevator=flight.excitation + 0.05)
    assert not is_closed_loop(opened) and control_effectiveness(opened, AIRCRAFT) is None


def test_other_methods_with_the_wrong_sign_are_withheld() -> None:
    """GIVEN estimates of either sign WHEN compared with the consistent one THEN a wrong one is withheld."""
    closed = control_effectiveness(linear_flight(0.10, 0.15, 1), AIRCRAFT)
    assert closed is not None
    for value, kept in ((-20.0, False), (40.0, True)):
        one = (estimate("M_q", "1/s", -4.0, 1.0), estimate("M_delta", "1/s^2", value, 2.0))
        made = consistent_result(EstimationResult("output error", estimates=one, covariance=np.eye(2)), closed)
        assert (made.estimate("M_delta") is not None) == kept and made.covariance is not None
        assert len(made.covariance) == len(made.estimates) and bool(made.withheld) == (not kept)


@pytest.mark.validate
def test_sign_of_the_elevator_in_100_closed_loop_logs(tmp_path: Path) -> None:
    """GIVEN 100 logs of two birds, half without excitation WHEN identified THEN no method has the wrong sign.

    An effectiveness is given for at least a quarter of the logs with excitation.
    """
    mission = tmp_path / "hold.toml"
    mission.write_text(MISSION, encoding="utf-8")
    wrong, given, without = [], 0, 0
    for seed in range(100):
        excited = seed % 4 < 2
        vehicle, tables = px4_tables(seed, excited, mission)
        path = tmp_path / f"{seed}.ulg"
        path.write_bytes(ulog(tables))
        with opened_log(path) as log:
            try:
                modes = identified(log, "modes", vehicle).modes
            except InputError:
                without += 1
                continue
        path.unlink()
        assert modes is not None
        values = [one for mode in modes.modes for one in mode.derivatives if one.name == "M_delta"]
        values += [one for result in modes.results for one in result.estimates if one.name == "M_delta"]
        given += excited and bool(values)
        wrong += [(seed, one) for one in values if one.high < 0.0]
    told = f"with an effectiveness {given} of 50 excited, without a result {without}, wrong sign {len(wrong)}"
    print(f"\n{told}")  # noqa: T201
    assert not wrong
    assert given >= 12
