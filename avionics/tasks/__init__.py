"""The tasks of the processors: each takes what its module needs out of the state, steps it, publishes."""
