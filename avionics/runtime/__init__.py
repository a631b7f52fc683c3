"""Flight computer process: main loop and input queue."""
