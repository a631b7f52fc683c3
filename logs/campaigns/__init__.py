"""Thousands of flights: a grid or a draw over what enters a flight, flown on a cluster, and what came of it."""
