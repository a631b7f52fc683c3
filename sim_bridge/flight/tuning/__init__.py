"""Gains of the flight computer's loops from a linear model: the cascade, its file, its proof in flight."""
