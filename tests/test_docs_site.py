"""The documentation site: tutorials run, every page is in the navigation, no broken link."""

from __future__ import annotations

import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))


@pytest.mark.parametrize("page", TUTORIALS, ids=[page.stem for page in TUTORIALS])
def test_tutorial_runs(page: Path, tmp_path: Path) -> None:
    """GIVEN the Python blocks of a tutorial WHEN they run in order in an empty folder THEN none fails."""
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.S | re.M)
    assert blocks
    shutil.copy(ROOT / "tests" / "data" / "logs" / "vtol_bench.ulg", tmp_path / "flight.ulg")
    script = tmp_path / "tutorial.py"
    script.write_text("import matplotlib\nmatplotlib.use('Agg')\n" + "\n".join(blocks), encoding="utf-8")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_site_has_every_page_and_no_broken_link(tmp_path: Path) -> None:
    """GIVEN the documents WHEN the site is built THEN Sphinx has no warning, and every page is in the navigation."""
    pytest.importorskip("sphinx")
    pytest.importorskip("pydata_sphinx_theme")
    build = ROOT / "docs" / "site" / "build.py"
    done = subprocess.run([sys.executable, build, tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "index.html").is_file()
    pages = runpy.run_path(str(ROOT / "docs" / "site" / "pages.py"))
    listed = {name for names in pages["SECTIONS_OF_THE_SITE"].values() for name in names}
    written = {path.relative_to(ROOT / "docs").with_suffix("").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert written <= listed
