"""The world: vehicles, air, dynamics, actuators, sensors, and the bridge that plays it to an autopilot."""
