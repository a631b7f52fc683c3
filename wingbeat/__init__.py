"""Flight software, simulation and system identification of flapping-wing aircraft.

Public names are loaded on first use, so that importing one leaf module loads nothing else.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "Flight": "wingbeat.api.flights",
    "Identification": "wingbeat.api.identification",
    "LinearMotion": "wingbeat.api.steady",
    "LogReport": "wingbeat.api.logs",
    "Simulation": "wingbeat.api.simulation",
    "SteadyFlight": "wingbeat.api.steady",
    "Tuning": "wingbeat.api.tuning",
    "TunnelForces": "wingbeat.api.tunnel",
    "Vehicle": "wingbeat.api.vehicles",
    "campaign": "wingbeat.api.campaigns",
    "check_log": "wingbeat.api.logs",
    "fly": "wingbeat.api.flights",
    "identify": "wingbeat.api.identification",
    "import_log": "wingbeat.api.logs",
    "linearize": "wingbeat.api.steady",
    "load_vehicle": "wingbeat.api.vehicles",
    "new_bird": "wingbeat.api.tuning",
    "open_log": "wingbeat.api.flights",
    "trim": "wingbeat.api.steady",
    "tune": "wingbeat.api.tuning",
    "tunnel": "wingbeat.api.tunnel",
    "vehicle_names": "wingbeat.api.vehicles",
}
"""module by public name"""
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module 'wingbeat' has no attribute {name!r}; it has: {', '.join(_HOME)}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME})
