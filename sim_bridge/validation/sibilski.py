"""Sibilski, Dynamics of Micro-Air-Vehicle with Flapping Wings: an entomopter of which only the span is printed."""

from __future__ import annotations

import math

from sim_bridge.validation.row import Check, Row, figure, unreproducible


def drift_rows() -> list[Row]:
    """The open loop of Fig. 4: histories without numbers."""
    printed = figure("Fig. 4", "open loop: an oscillation on a vertical drift", "-", math.nan)
    why = "prints a span of 80 to 100 mm, but neither masses nor wing motion nor scales that could be read"
    return [unreproducible(printed, None, why)]


CHECKS = (Check("open loop", drift_rows),)
