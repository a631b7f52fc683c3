"""The weight of things: one field everywhere, along NED down."""

GRAVITY = 9.80665
"""m/s^2; standard acceleration of free fall (CGPM 1901)"""
