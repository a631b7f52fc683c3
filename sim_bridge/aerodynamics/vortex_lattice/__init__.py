"""Unsteady vortex lattice: ring vortices over any number of surfaces, with a wake shed in time."""
