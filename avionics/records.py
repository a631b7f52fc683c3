"""How the fast loop builds its NamedTuples."""

from __future__ import annotations

new = tuple.__new__
"""``new(Kind, values)`` builds a NamedTuple at two thirds of its constructor's time; ``values`` holds every field"""
