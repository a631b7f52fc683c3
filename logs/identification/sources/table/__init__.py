"""Tables of numbers with a column mapping."""
