"""Air loads: wing sections, tail and fuselage."""
