"""The ``wingbeat`` command, the ground end of the MAVLink link, and the views."""
