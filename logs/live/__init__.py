"""A flight while it is being recorded, for Foxglove and Lichtblick."""
