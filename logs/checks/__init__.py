"""Checks of a log before anybody identifies from it: clocks, sensors, drive and content."""
