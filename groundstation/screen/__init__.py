"""The live screen of a ground station, on textual: what shows the views and takes the keys."""
