"""Wing drives and what they draw from the battery."""
