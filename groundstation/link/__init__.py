"""The ground end of the MAVLink link: telemetry and transactions."""
