"""The air, the wind, the Earth's shape and its magnetic field around the vehicle."""
