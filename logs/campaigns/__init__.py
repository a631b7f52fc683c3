"""Campaigns: many flights over a grid or random draws."""
