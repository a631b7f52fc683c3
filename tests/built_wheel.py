"""A wheel of this tree, and the folder that it is installed into."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation")
IGNORED = shutil.ignore_patterns("__pycache__", ".*", "*.so")
OPTIONS = ("-m", "pip", "--quiet", "--disable-pip-version-check")
PIP = (sys.executable, *OPTIONS)


def build_wheel(work: Path, *, compiled: bool = False) -> Path:
    """Build it in the folder ``work``.

    Python is built with the packages that are installed here; compiled code as on a computer that has none of them,
    for which pip needs a network.
    """
    for name in PACKAGES:
        shutil.copytree(ROOT / name, work / "source" / name, ignore=IGNORED)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, work / "source")
    python, needs = sys.executable, ["--no-build-isolation", "--no-index"]
    if compiled:
        venv.create(work / "empty", symlinks=True, with_pip=True)
        python, needs = str(work / "empty" / "bin" / "python"), []
    command = [python, *OPTIONS, "wheel", "--no-deps", *needs, "--wheel-dir", str(work), "./source"]
    environment = os.environ | {"WINGBEAT_COMPILED": str(int(compiled))}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(command, cwd=work, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (path,) = work.glob("wingbeat-*.whl")
    return path


def install_wheel(wheel: Path, folder: Path) -> Path:
    """Install it into ``folder``, which a process takes it from if it is on its ``PYTHONPATH``."""
    subprocess.run([*PIP, "install", "--no-deps", "--no-index", "--target", str(folder), str(wheel)], check=True)
    return folder


def run_installed(folder: Path, *words: str) -> str:
    """Run Python with what is installed in ``folder``; return what it prints."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    done = subprocess.run([sys.executable, *words], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout
