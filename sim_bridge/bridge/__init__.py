"""The world's side of the MAVLink bridge: plays a simulated vehicle to a flight computer, in lockstep."""
