"""Vibration of the airframe at the IMU: structural modes excited by the drive and by the air behind the wings."""
