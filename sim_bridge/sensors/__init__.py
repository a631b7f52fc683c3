"""From what is true at the vehicle to what its sensors say: ranges, resolutions, noise, offsets, delays."""
