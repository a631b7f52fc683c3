"""The live screen of the ground station (textual)."""
