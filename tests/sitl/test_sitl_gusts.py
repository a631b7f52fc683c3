"""Two hundred flights in gusts (``make validate``; an hour on two cores).

None is lost in what small unmanned aircraft are said to meet. MIL-F-8785C's moderate gusts are those of a wind of
30 kt at 20 ft, whatever the flight's mean wind: 3 m/s level at the height of a flare, for who cruises at 6.8 m/s.
"""

from __future__ import annotations

import sys
from functools import cache

import pytest
from gusts import SEEDS, Outcome, outcomes, summary

pytestmark = pytest.mark.validate

HOME = 120
"""-; of 200 flights in MIL-F-8785C's moderate gusts, at least"""


@cache
def flights(level: str) -> tuple[Outcome, ...]:
    """All in gusts of a level; who is lost is told."""
    kept = []
    for flight in outcomes(level, SEEDS):
        kept.append(flight)
        if flight.lost:
            sys.stdout.write(flight.line + "\n")
    sys.stdout.write(summary(kept) + "\n")
    return tuple(kept)


@pytest.mark.parametrize(
    "level",
    [
        "light",
        "small_uav_moderate",
        pytest.param(
            "moderate", marks=pytest.mark.xfail(strict=True, reason="a wind of 30 kt is beyond a bird of 6.8 m/s")
        ),
    ],
)
def test_no_flight_is_lost(level: str) -> None:
    assert not [flight.line for flight in flights(level) if flight.lost]


def test_most_flights_come_home_in_gusts_of_a_wind_of_30_kt() -> None:
    assert sum(not flight.lost for flight in flights("moderate")) >= HOME
