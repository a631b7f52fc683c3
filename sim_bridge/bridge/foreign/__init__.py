"""Autopilots that are not ours on our world: PX4's and ArduPilot's simulator interfaces."""
