"""The world's topics, beside those of `avionics.topics`."""

from __future__ import annotations

from typing import Any

from sim_bridge import messages as m
from wingbeat.message import Event, RecorderStatus
from wingbeat.topic import Topic

STATE = Topic("/truth/state", m.TruthState, 1000, 200.0)
WING = Topic("/truth/wing", m.TruthWing, 1001, 200.0)
LOADS = Topic("/truth/loads", m.TruthLoads, 1002, 100.0)
EVENTS = Topic("/truth/events", Event, 1003, 0.0)
"""faults that began and ended"""
RECORDER = Topic("/truth/recorder", RecorderStatus, 1004, 0.0, deterministic=False)
"""each time the world's recorder had to leave out more"""

TOPICS: tuple[Topic[Any], ...] = (STATE, WING, LOADS, EVENTS, RECORDER)
