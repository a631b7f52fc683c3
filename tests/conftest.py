"""What all tests share."""

from hypothesis import settings

# A machine that is busy with something else makes a test late, not wrong.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")
