"""Constants of nature and of standards, each written once."""

STANDARD_GRAVITY = 9.80665
"""m/s^2; standard acceleration of free fall (CGPM 1901)"""
