"""The memory: flights recorded to MCAP, read back as columns, joined, repaired and exported."""
