"""What a map can ask for: its sections by the words of the command."""

MODES, AERO, PATH, STROKE, ALL = SUBJECTS = ("modes", "aero", "path", "stroke", "all")
SECTIONS = tuple(name for name in SUBJECTS if name != ALL)
"""-; the section of a map that says what to fit, by the subject's own name"""
