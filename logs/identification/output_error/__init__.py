"""Output error: a model flies the measured inputs again, its parameters fitted to the measured outputs."""
