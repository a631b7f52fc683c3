"""Inner loops: attitude setpoints to elevator and roll command."""
