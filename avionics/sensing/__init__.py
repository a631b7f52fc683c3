"""From raw counts to physical quantities: power, wing angle, air data."""
