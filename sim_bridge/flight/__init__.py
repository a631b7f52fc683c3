"""World and autopilot joined: the simulated world of a flight, and whole flights in one process."""
