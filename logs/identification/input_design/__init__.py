"""Input design: predicted errors of parameters, and the maneuver that minimizes them."""
