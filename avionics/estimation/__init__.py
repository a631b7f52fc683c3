"""Estimation of attitude, altitude and position."""
