"""The documentation site: tutorials run, every page is in the navigation, no broken link."""

from __future__ import annotations

import importlib
import re
import runpy
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from groundstation.command.main import SUBCOMMANDS

ROOT = Path(__file__).parents[1]
TUTORIALS = sorted((ROOT / "docs" / "tutorials").glob("*.md"))
GUIDES = sorted((ROOT / "docs" / "howto").glob("*.md"))
PYTHON = re.compile(r"^```python\n(.*?)^```", flags=re.S | re.M)
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", flags=re.S | re.M)
RUN = [*TUTORIALS, *(page for page in GUIDES if PYTHON.search(page.read_text(encoding="utf-8")))]
QUICK = {"add_control_law", "add_estimator", "px4_log"}
"""pages of which `make test` runs the blocks; the others fly missions: run by `make validate`"""
MAX_WORDS = 400
"""words of a how-to guide, code aside"""


@pytest.mark.parametrize("page", GUIDES, ids=[page.stem for page in GUIDES])
def test_guide_is_short_and_its_commands_are_valid(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """GIVEN a how-to guide THEN it is short, and the parsers accept every command that it shows."""
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "flight.mcap").touch()
    monkeypatch.chdir(tmp_path)
    text = page.read_text(encoding="utf-8")
    assert len(re.sub(r"^```.*?^```", "", text, flags=re.S | re.M).split()) <= MAX_WORDS
    commands = "".join(code for language, code in FENCE.findall(text) if not language)
    for line in filter(None, commands.splitlines()):
        program, name, *arguments = shlex.split(line, comments=True)
        if program == "wingbeat":
            module = importlib.import_module(SUBCOMMANDS[name].module)
            module.build_parser().parse_args(arguments)


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, id=page.stem, marks=[] if page.stem in QUICK else [pytest.mark.validate]) for page in RUN],
)
def test_tutorial_runs(page: Path, tmp_path: Path) -> None:
    """GIVEN the Python blocks of a page WHEN they run in order in an empty folder THEN none fails."""
    blocks = PYTHON.findall(page.read_text(encoding="utf-8"))
    assert blocks
    shutil.copy(ROOT / "tests" / "data" / "logs" / "vtol_bench.ulg", tmp_path / "flight.ulg")
    script = tmp_path / "tutorial.py"
    script.write_text("import matplotlib\nmatplotlib.use('Agg')\n" + "\n".join(blocks), encoding="utf-8")
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.validate
def test_figures_of_the_explanations_are_drawn(tmp_path: Path, standard_flight: Path) -> None:
    """GIVEN the flight of the explanations THEN their figures can be drawn, and no picture is without its figure."""
    pytest.importorskip("matplotlib")
    script = ROOT / "docs" / "draw_explanations.py"
    done = subprocess.run(
        [sys.executable, script, standard_flight, tmp_path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    committed = {path.name for path in (ROOT / "docs" / "explanation").glob("*.png")}
    assert {path.name for path in tmp_path.glob("*.png")} == committed


def test_every_page_is_in_the_navigation() -> None:
    pages = runpy.run_path(str(ROOT / "docs" / "site" / "pages.py"))
    listed = {name for names in pages["SECTIONS_OF_THE_SITE"].values() for name in names}
    written = {path.relative_to(ROOT / "docs").with_suffix("").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert written <= listed


@pytest.mark.validate
def test_site_is_built_without_a_warning(tmp_path: Path) -> None:
    """GIVEN the documents WHEN the site is built THEN Sphinx has no warning, such as of a broken link."""
    pytest.importorskip("sphinx")
    pytest.importorskip("pydata_sphinx_theme")
    build = ROOT / "docs" / "site" / "build.py"
    done = subprocess.run([sys.executable, build, tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "index.html").is_file()
