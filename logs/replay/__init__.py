"""Recorded flights and recordings run through the flight code again."""
