"""The wheel holds what the tree holds: every file that a package reads beside its modules."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation")
IGNORED = shutil.ignore_patterns("__pycache__", ".*")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    work = tmp_path_factory.mktemp("wheel")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, work / "source" / name, ignore=IGNORED)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, work / "source")
    build = ["pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--wheel-dir", str(work)]
    done = subprocess.run([sys.executable, "-m", *build, str(work / "source")], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (path,) = work.glob("wingbeat-*.whl")
    return zipfile.ZipFile(path)


def test_wheel_has_every_file_of_the_tree(wheel: zipfile.ZipFile) -> None:
    files = (path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file())
    expected = {
        str(path)
        for path in files
        if path.suffix != ".pyc"
        and not any(part.startswith(".") for part in path.parts)
        and (path.suffix != ".md" or "data" in path.parts)  # of data, its attribution
    }
    contained = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert contained == expected
    assert "logs/pages/templates/chapters.css" in contained  # the comparison compares something


def test_wheel_has_its_command_and_license(wheel: zipfile.ZipFile) -> None:
    (info,) = {name.split("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    assert b"wingbeat = groundstation.command.main:main" in wheel.read(f"{info}/entry_points.txt")
    assert any(name.startswith(info) and name.endswith("LICENSE") for name in wheel.namelist())
