"""Where the data come from: the topics of a log, and what stands in for those it lacks."""
