"""A wheel of this tree, and the folder that it is installed into."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PACKAGES = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation")
IGNORED = shutil.ignore_patterns("__pycache__", ".*", "*.so")
PIP = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")


def build_wheel(work: Path, *, compiled: bool = False) -> Path:
    """Build it in the folder ``work``, with the packages that are installed here."""
    for name in PACKAGES:
        shutil.copytree(ROOT / name, work / "source" / name, ignore=IGNORED)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, work / "source")
    command = [*PIP, "wheel", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(work), "./source"]
    environment = os.environ | {"WINGBEAT_COMPILED": str(int(compiled))}
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
