"""Mixing of throttle, elevator and roll command to wing drives and tail."""
