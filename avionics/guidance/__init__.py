"""Guidance: modes, missions, and the outer loops of position and altitude."""
