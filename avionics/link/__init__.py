"""The MAVLink link: toward the ground stations, and toward a simulated world in place of the hardware."""
