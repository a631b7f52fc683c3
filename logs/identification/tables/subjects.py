"""What a map can ask for."""

MODES, AERO, ALL = SUBJECTS = ("modes", "aero", "all")
