"""Identification from any table of numbers: a map says what its columns are and what is to be fitted to them."""
