"""Estimators of the stroke-averaged flight of a flapping-wing aircraft."""
