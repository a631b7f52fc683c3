"""What the flight computer believes of attitude, altitude and position."""
