"""Two hundred flights in gusts (``make validate``; two hours on two cores).

Moderate gusts are those of a wind of 30 kt at 20 ft, whatever the mean wind of the flight: 1.5 m/s up and down, 3 m/s
level at the height of a flare, for a vehicle that cruises at 6.8 m/s.
"""

from __future__ import annotations

import sys

import pytest
from gusts import SEEDS, outcomes, summary

pytestmark = pytest.mark.validate


@pytest.mark.parametrize("level", ["light", "moderate"])
def test_no_flight_is_lost(level: str) -> None:
    flights = []
    for flight in outcomes(level, SEEDS):
        flights.append(flight)
        if flight.lost:
            sys.stdout.write(flight.line + "\n")
    sys.stdout.write(summary(flights) + "\n")
    assert not [flight.line for flight in flights if flight.lost]
