"""Sensor models: range, resolution, noise, offset and delay."""
