"""Steady flight of the simulated vehicle: periodic orbits of the stroke, and the modes around them."""
