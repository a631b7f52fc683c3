"""The modes of motion: frequencies and dampings by several methods, with their errors."""
