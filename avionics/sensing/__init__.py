"""Conversion of raw counts to physical quantities, and sensor fault detection."""
