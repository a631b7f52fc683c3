"""From throttle, elevator and roll command to the wing drives and the tail."""
