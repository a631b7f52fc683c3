"""Flight software: sensing, estimation, guidance, control and the MAVLink link."""
