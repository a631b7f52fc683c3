"""Build of a wheel with compiled flight code: ``WINGBEAT_COMPILED=1 pip wheel . --no-deps``.

Without the variable, and in source distributions and editable installations, all code stays Python and no compiler is
needed.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

PACKAGES = ("estimation", "guidance", "mixing", "sensing", "stabilization", "tasks")
"""of ``avionics``"""
MODULES = {
    "avionics": ("autopilot", "control_laws", "limits", "processors", "situation", "state", "timebase"),
    "wingbeat": ("rotations",),
}
"""Messages and gains stay Python, because mypyc makes tuples no faster, and so do `wingbeat.quaternions` and
`wingbeat.atmosphere`, whose functions Numba compiles from their source."""
CHECKS = ["--config-file=", "--ignore-missing-imports", "--follow-imports=silent"]
"""of mypy: the code is checked elsewhere, and its dependencies are not installed where a wheel is built"""
COMPILER = ["mypy>=1.11,<3", "numpy>=2.0,<3"]
"""needed by a build of compiled code; NumPy for its types"""


def flight_code() -> list[str]:
    """Return the files that are compiled, relative to this folder."""
    packages = [path for name in PACKAGES for path in sorted(Path("avionics", name).glob("*.py"))]
    modules = [Path(package, f"{name}.py") for package, names in MODULES.items() for name in names]
    return [str(path) for path in packages + modules if path.name != "__init__.py"]


def requested(environment: Mapping[str, str], command: Sequence[str]) -> tuple[bool, list[str]]:
    """Return whether a setuptools ``command`` compiles, and what it needs."""
    wanted = environment.get("WINGBEAT_COMPILED") == "1"
    return wanted and "bdist_wheel" in command, COMPILER if wanted else []


def main() -> None:
    """Run setuptools."""
    from setuptools import setup

    compiles, needs = requested(os.environ, sys.argv)
    if not compiles:
        setup(setup_requires=needs)
        return
    from mypyc.build import mypycify

    extensions = mypycify([*CHECKS, *flight_code()], opt_level="3", debug_level="0")
    if sys.platform != "win32":
        for extension in extensions:
            # A fused multiply-add rounds once where Python rounds twice: the bits would not be the same.
            extension.extra_compile_args.append("-ffp-contract=off")
    setup(ext_modules=extensions)


if __name__ == "__main__":
    main()
