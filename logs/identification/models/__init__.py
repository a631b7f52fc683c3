"""Models of the motion, of actuators, drives and wings."""
