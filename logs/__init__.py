"""Recording of flights to MCAP, reading, joining, repair and export."""
