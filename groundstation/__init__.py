"""The person: the ``wingbeat`` command, the ground end of the MAVLink link, and the views."""
