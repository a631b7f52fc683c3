"""Equations of motion and ground contact."""
