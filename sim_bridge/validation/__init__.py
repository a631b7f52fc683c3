"""Published figures and those of the simulation, computed on request; one file for each paper."""
