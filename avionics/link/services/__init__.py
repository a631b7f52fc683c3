"""MAVLink services, one module each: messages to replies and commands."""
