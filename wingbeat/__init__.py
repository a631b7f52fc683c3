"""Leaf modules that all packages share; importing one loads nothing else of Wingbeat."""
