"""What a map can ask for: its sections by the words of the command."""

MODES, AERO, PATH, STROKE, STAND, TORQUE_SPEED, TWIST, SERVO, POWER, ALL = SUBJECTS = (
    "modes", "aero", "path", "stroke", "stand", "torque_speed", "twist", "servo", "power", "all",
)  # fmt: skip
SECTIONS = tuple(name for name in SUBJECTS if name != ALL)
"""-; the section of a map that says what to fit, by the subject's own name"""
