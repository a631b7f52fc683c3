"""The ground end of the MAVLink link: what the vehicle says, and conversations with it."""
