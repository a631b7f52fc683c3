"""Vibration at the IMU of a flapping aircraft: analysis of a log, and the vibration section of its vehicle file."""
