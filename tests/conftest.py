"""What all tests share."""

import os
import tempfile

from hypothesis import settings

# No test reads or writes the parameters that a user keeps.
os.environ["WINGBEAT_STATE"] = tempfile.mkdtemp(prefix="wingbeat-state-")

# A machine that is busy with something else makes a test late, not wrong.
settings.register_profile("unhurried", deadline=None)
settings.load_profile("unhurried")
