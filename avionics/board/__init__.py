"""The hardware, as the flight code sees it: sensors in, actuators out."""
