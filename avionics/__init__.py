"""What flies: sensing, estimation, guidance, stabilization, mixing, and the MAVLink link."""
