"""Fits that the sections of a map request."""
