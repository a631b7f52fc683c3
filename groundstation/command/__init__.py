"""The ``wingbeat`` command: one module per subcommand."""
