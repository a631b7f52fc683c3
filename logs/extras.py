"""Packages that Wingbeat reads and writes other formats with, loaded when they are asked for."""

from __future__ import annotations

import importlib
from typing import Any

from avionics.quantities import BadInput


def load_extra(module: str, package: str, what: str, install: str = "") -> Any:
    """Import ``module``, which ``what`` needs.

    Raises:
        BadInput: it is not installed; the line says how to ``install`` the ``package``.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise BadInput(
            f"{what} needs {package}, which is not installed: {install or f'pip install {package}'}"
        ) from None
