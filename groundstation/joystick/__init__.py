"""Joysticks, gamepads and RC transmitters on USB: devices, calibration, settings and MANUAL_CONTROL."""
