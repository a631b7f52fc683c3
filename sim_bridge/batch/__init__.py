"""Many vehicles of one kind in manual flight, advanced together by compiled code on all cores."""

from sim_bridge.batch.manual import ManualGains
from sim_bridge.batch.vehicles import DIVERGED, ON_GROUND, TICKS, Conditions, Start, VehicleBatch

__all__ = ["DIVERGED", "ON_GROUND", "TICKS", "Conditions", "ManualGains", "Start", "VehicleBatch"]
