"""Whether what the estimators say of their own errors and innovations is so, on a flight whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from simulate import Flight

from avionics import topics
from avionics.estimation.geodesy import to_local
from sim_bridge import topics as truth_topics
from sim_bridge.environment.geodesy import geodetic_from_ned
from sim_bridge.environment.home import COLLEGE_PARK

SETTLED = 3.0
"""s; after the launch"""

Columns = Mapping[str, Any]


class Consistency:
    """Mean squares, each divided by the variance that was told: 1 where the variance is right."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        launch, end = flight.air_time()
        self._span = ((launch + SETTLED) * 1e6, end * 1e6)
        self._air, self._altitude, self._position = (
            self._inside(topic) for topic in (topics.AIR_DATA, topics.ALTITUDE, topics.POSITION)
        )
        wing = self._inside(topics.WING)
        truth = flight.truth
        # Estimates are of the flight path: the fuselage heaves about it with every stroke.
        self._stroke = round(
            1e6 / wing["frequency"][wing["frequency"] > 0.0].mean() / np.diff(truth["time_us"]).mean()
        )

    def errors(self) -> dict[str, float]:
        """Of the published estimates."""
        truth, air, height, place = self._flight.truth, self._air, self._altitude, self._position
        mean, trailing = np.ones(self._stroke) / self._stroke, len(truth["time_us"])
        path = {name: np.convolve(truth[name], mean, "same") for name in ("airspeed", "v_north", "v_east")}
        climb = -np.convolve(truth["v_down"], mean)[:trailing]
        own = {
            "airspeed": (air, air["airspeed"], path["airspeed"], "airspeed_variance"),
            "altitude": (height, height["altitude"], self._flight.altitude(), "altitude_variance"),
            "climb": (height, height["climb_rate"], climb, "climb_variance"),
        }
        found = {name: [self._square(*each)] for name, each in own.items()}
        north, east = self._earth()
        for name, axes, variance in (
            ("position", ((north, truth["north"]), (east, truth["east"])), "position_variance"),
            ("velocity", tuple((place[v], path[v]) for v in ("v_north", "v_east")), "velocity_variance"),
            ("wind", tuple((place[w], truth[w]) for w in ("wind_north", "wind_east")), "wind_variance"),
        ):
            found[name] = [self._square(place, stated, true, variance) for stated, true in axes]
        return {name: float(np.mean(squares)) for name, squares in found.items()}

    def innovations(self) -> dict[str, float]:
        """Of the measurements, those of fixes counted once."""
        stated = self._position
        names = ("innovation_north", "innovation_east", "innovation_v_north", "innovation_v_east")
        new = np.flatnonzero(np.any([np.diff(stated[name]) != 0.0 for name in names], axis=0)) + 1
        place, velocity = (
            np.mean([stated[name][new] ** 2 for name in pair], axis=0) / stated[f"{of}_innovation_variance"][new]
            for pair, of in ((names[:2], "place"), (names[2:], "velocity"))
        )
        own = {
            name: each["innovation"] ** 2 / each["innovation_variance"]
            for name, each in (("airspeed", self._air), ("altitude", self._altitude))
        }
        return {name: float(np.mean(s)) for name, s in {**own, "position": place, "velocity": velocity}.items()}

    def _inside(self, topic: Any) -> Columns:
        columns = self._flight.columns(topic)
        inside = (columns["time_us"] > self._span[0]) & (columns["time_us"] < self._span[1])
        return {name: values[inside] for name, values in columns.items()}

    def _square(self, columns: Columns, stated: Any, true: Any, variance: str) -> float:
        at = np.interp(columns["time_us"], self._flight.columns(truth_topics.STATE)["time_us"], true)
        return float(np.mean((stated - at) ** 2 / columns[variance]))

    def _earth(self) -> tuple[Any, Any]:
        """Estimated place (m) from the launch place on earth, not from where the receiver said it was."""
        latitude, longitude, _ = geodetic_from_ned(COLLEGE_PARK, (0.0, 0.0, 0.0))
        pairs = zip(self._position["latitude"], self._position["longitude"], strict=True)
        north, east = np.array([to_local((latitude, longitude), *pair) for pair in pairs]).T
        return north, east
