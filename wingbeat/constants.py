"""Constants of nature and of standards."""

STANDARD_GRAVITY = 9.80665
"""m/s^2; standard acceleration of free fall (CGPM 1901)"""
