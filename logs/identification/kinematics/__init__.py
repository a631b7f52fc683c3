"""How a vehicle moved: from markers to bodies, coordinates and speeds."""
