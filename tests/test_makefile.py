"""The targets of the Makefile, as a fresh clone meets them."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not there")
@pytest.mark.parametrize("target", ["fly", "test", "bench", "validate"])
def test_a_target_of_a_fresh_clone_begins_with_the_environment(target: str, tmp_path: Path) -> None:
    """Asked what it would do, it installs before it runs, and make finds nothing circular."""
    for name in ("Makefile", "pyproject.toml"):
        shutil.copy(ROOT / name, tmp_path)
    asked = ["make", "--dry-run", "--no-print-directory", target]
    alone = {name: value for name, value in os.environ.items() if not name.startswith("MAKE") and name != "MFLAGS"}
    told = subprocess.run(asked, cwd=tmp_path, env=alone, capture_output=True, text=True, check=True)
    assert told.stderr == ""
    lines = told.stdout.splitlines()
    made = next(number for number, line in enumerate(lines) if "-m venv" in line)
    installed = next(number for number, line in enumerate(lines) if " install " in line and line.endswith("-e ."))
    used = [n for n, line in enumerate(lines) if "wingbeat fly" in line or "-m pytest" in line]
    assert made < installed < used[-1]
