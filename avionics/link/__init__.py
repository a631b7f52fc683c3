"""MAVLink link to ground stations, and to a simulator in place of the hardware."""
