"""Build the documentation site: ``python docs/site/build.py build/site``.

The pages of ``docs/``, the READMEs of the packages and generated reference pages are put into one source tree, with
the links between them rewritten, and built by Sphinx. A broken link is an error. The pages open from ``file://``.
"""

from __future__ import annotations

import posixpath
import re
import shutil
import sys
from pathlib import Path

from sphinx.cmd.build import build_main

sys.path.insert(0, str(Path(__file__).parent))

import pages

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]*)(#[^)\s]*)?\)")
FENCE = re.compile(r"^```.*?^```", re.S | re.M)
LEFT_OUT = "sim_bridge/validation/data"
"""folder whose READMEs are licenses of data"""


def readmes() -> dict[str, str]:
    """Page by README, both relative to their roots."""
    found = {"README.md": "index.md"}
    for package in pages.PACKAGES:
        for path in sorted(ROOT.glob(f"{package}/**/README.md")):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(LEFT_OUT):
                found[name] = f"packages/{posixpath.dirname(name).replace('/', '.')}.md"
    return found


def sources() -> dict[str, tuple[str, str]]:
    """Page to its text and to the file of the repository that its links are relative to."""
    found = {}
    for path in sorted((ROOT / "docs").rglob("*.md")):
        name = path.relative_to(ROOT).as_posix()
        found[name.removeprefix("docs/")] = (path.read_text(encoding="utf-8"), name)
    for name, page in readmes().items():
        found[page] = ((ROOT / name).read_text(encoding="utf-8"), name)
    for page, write in pages.GENERATED.items():
        found[page] = (write(), f"docs/{page}")
    return found


def with_links(text: str, page: str, source: str, known: dict[str, str]) -> str:
    """Return a page with its links to other documents turned into links of the site.

    A link to a file of the repository that is no page becomes plain text.
    """

    def rewritten(match: re.Match[str]) -> str:
        mark, label, target, anchor = match[1], match[2], match[3], match[4] or ""
        if not target or "://" in target or target.startswith("mailto:"):
            return match[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        there = known.get(path) or known.get(f"{path}/README.md")
        if there is None:
            return label if (ROOT / path).exists() else match[0]
        return f"{mark}[{label}]({posixpath.relpath(there, posixpath.dirname(page) or '.')}{anchor})"

    parts, at = [], 0
    for fence in FENCE.finditer(text):
        parts += [LINK.sub(rewritten, text[at : fence.start()]), fence[0]]
        at = fence.end()
    return "".join([*parts, LINK.sub(rewritten, text[at:])])


def assemble(folder: Path) -> None:
    """Write the source tree of the site."""
    shutil.rmtree(folder, ignore_errors=True)
    tree = sources()
    known = {source: page for page, (_, source) in tree.items()}
    pictures = {path.relative_to(ROOT).as_posix(): path for path in (ROOT / "docs").rglob("*.png")}
    known |= {name: name.removeprefix("docs/") for name in pictures}
    for page, (text, source) in tree.items():
        path = folder / page
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(with_links(text, page, source, known), encoding="utf-8")
    for name, path in pictures.items():
        shutil.copy(path, folder / name.removeprefix("docs/"))
    sections = pages.contents(sorted(page for page in tree if page.startswith("packages/")))
    for name, text in sections.items():
        with (folder / f"{name}.md").open("a", encoding="utf-8") as page_file:
            page_file.write(text)
    shutil.copy(HERE / "conf.py", folder)


def main(out: Path) -> int:
    """Assemble and build; return the exit code of Sphinx."""
    folder = ROOT / "build" / "docs"
    assemble(folder)
    return int(build_main(["-q", "-W", "--keep-going", "-b", "html", "-j", "auto", str(folder), str(out)]))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
