"""The ``wingbeat`` command: one file for each subcommand."""
