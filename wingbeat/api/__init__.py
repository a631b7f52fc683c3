"""The public Python API: flights, simulation, logs, steady flight, campaigns."""
