"""Missions as TOML files, and their reader."""

from avionics.missions.reader import check_mission, load_mission, mission_names

__all__ = ["check_mission", "load_mission", "mission_names"]
