"""Calibration aboard: one file for each sensor, from samples gathered at rest, while turned, or in flight."""
