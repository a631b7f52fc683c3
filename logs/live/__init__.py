"""Live view of a recording for Foxglove and Lichtblick."""
