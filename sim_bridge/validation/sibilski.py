"""Sibilski, Dynamics of Micro-Air-Vehicle with Flapping Wings: an entomopter of which only the span is printed."""

from __future__ import annotations

from sim_bridge.validation.insects import drift_rows, hover_rows
from sim_bridge.validation.row import Check

CHECKS = (Check("open loop", drift_rows), Check("hover", hover_rows, slow=True))
