"""Estimators: one file per method."""
