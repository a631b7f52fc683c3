"""The flight computer as a process: main loop of board, flight code, link and recorder; input queue."""
