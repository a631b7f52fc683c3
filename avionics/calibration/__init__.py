"""Sensor calibration on board: one module for each sensor."""
