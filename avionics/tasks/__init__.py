"""Tasks of the processors: each advances a module of the state and publishes."""
