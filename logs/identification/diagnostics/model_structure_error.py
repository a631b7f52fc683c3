"""Share of a fitted delay that stands for dynamics that a model does not contain."""

from __future__ import annotations


def share_of_lack(delay: float, variance: float, sure: float) -> float:
    """Share (0 to 1) of a ``delay`` with the ``variance`` of its noise that counts as what a model lacks.

    None below ``sure`` standard errors; above, as far as its square exceeds twice its variance, from where on a model
    with it would forecast better (Akaike, IEEE Trans. Automatic Control 19(6), 1974).
    """
    if not delay**2 > sure**2 * variance > 0.0:
        return 0.0
    return 1.0 - 2.0 * variance / delay**2
