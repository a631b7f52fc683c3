"""The world's topics, beside those of `avionics.topics`."""

from __future__ import annotations

from avionics.topics import Topic
from sim_bridge import messages as m

STATE = Topic("/truth/state", m.TruthState, 1000, 200.0)
WING = Topic("/truth/wing", m.TruthWing, 1001, 200.0)
LOADS = Topic("/truth/loads", m.TruthLoads, 1002, 100.0)

TOPICS: tuple[Topic, ...] = (STATE, WING, LOADS)
