"""The wing drives: torque, power and speed of their servos."""
