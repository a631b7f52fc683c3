"""From a log to a model: servo torque and power, and the short-period mode, each with its interval."""
