"""Optional packages, loaded on demand."""

from __future__ import annotations

import importlib
import re
import shlex
import sys
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from wingbeat.errors import InputError


def load_extra(module: str, package: str, what: str, install: Sequence[str] = ()) -> Any:
    """Import ``module``, which ``what`` needs.

    Raises:
        InputError: it is not installed; the message names the command that installs ``package``.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise InputError(
            f"{what} needs {package}, which is not installed: {pip_install(install or (package,))}"
        ) from None


def pip_install(packages: Sequence[str]) -> str:
    """Return the command that installs ``packages`` in the running Python, in the versions that Wingbeat requires."""
    return f"{_python()} -m pip install {shlex.join(map(_with_versions, packages))}"


def _python() -> str:
    """The Python that runs, from here: the one of that name elsewhere has other packages."""
    path = Path(sys.executable or "python3")
    beneath = path.is_relative_to(Path.cwd())
    return shlex.quote(str(path.relative_to(Path.cwd()) if beneath else path))


def _with_versions(package: str) -> str:
    """Return the requirement of a package from the extras, or its name if no extra has it."""
    try:
        required = metadata.requires("wingbeat") or []
    except metadata.PackageNotFoundError:
        return package
    asked = (line.partition(";")[0].strip() for line in required)
    return next((line for line in asked if re.match(rf"{re.escape(package)}(?![\w.\[-])", line)), package)
