"""Build of a wheel with compiled flight code: ``WINGBEAT_COMPILED=1 pip wheel . --no-deps``.

Without the variable, and in editable installations, all code stays Python and no compiler is needed.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from setuptools import setup

PACKAGES = ("estimation", "guidance", "mixing", "sensing", "stabilization", "tasks")
MODULES = ("autopilot", "control_laws", "limits", "processors", "situation", "timebase")
"""of ``avionics``; messages and gains stay Python, because mypyc makes tuples no faster"""


def flight_code() -> list[str]:
    """Return the files that are compiled."""
    packages = [path for name in PACKAGES for path in sorted(Path("avionics", name).glob("*.py"))]
    modules = [Path("avionics", f"{name}.py") for name in MODULES]
    return [str(path) for path in packages + modules if path.name != "__init__.py"]


compiled = os.environ.get("WINGBEAT_COMPILED") == "1"
if compiled and "bdist_wheel" in sys.argv:
    from mypyc.build import mypycify

    extensions = mypycify(flight_code(), opt_level="3", debug_level="0")
    if sys.platform != "win32":
        for extension in extensions:
            # A fused multiply-add rounds once where Python rounds twice: the bits would not be the same.
            extension.extra_compile_args.append("-ffp-contract=off")
    setup(ext_modules=extensions)
else:
    setup(setup_requires=["mypy>=1.11,<3", "numpy>=2.0,<3"] if compiled else [])
