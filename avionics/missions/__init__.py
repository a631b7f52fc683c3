"""Mission files and their readers."""

from avionics.missions.reader import check_mission, load_mission, load_plan, mission_names

__all__ = ["check_mission", "load_mission", "load_plan", "mission_names"]
