"""Linear models of measured quantities: least squares and what its errors are worth."""
