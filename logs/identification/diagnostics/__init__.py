"""Checks of data, models and estimates."""
