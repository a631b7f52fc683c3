"""Models that output error can fly: linear ones by their derivatives, nonlinear ones by their coefficients."""
