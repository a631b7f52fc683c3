"""Gains of the flight computer's loops from a linear model, their margins, their file, their proof in flight."""
