"""Replay of recorded flights and sensors through the flight code."""
