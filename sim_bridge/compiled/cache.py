"""Folders and keys of the disk cache of compiled kernels.

numba recompiles a kernel only when the kernel's own file changes. A compiled kernel contains the code of the kernels
that it calls, so a change in another file would go unnoticed. Here the key is a digest of the file, of all files of
the project that it imports, directly or indirectly, and of this package, which chooses the compiler's options.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numba

from sim_bridge.compiled.mode import CACHE_VARIABLE

PACKAGES = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation")
"""whose files are followed; a release of numba is part of numba's own key"""
UNMARKED_AGE = 86400.0
"""s; age at which folders of versions that kept no `_MARK` are removed"""
_ROOT = Path(__file__).parents[2]
_DECORATORS = tuple(Path(__file__).resolve().parent.glob("*.py"))
_MARK = "source"
"""file in the folder of a kernel file: the path of its source"""
_IMPORT = re.compile(r"^[ \t]*(?:from +([\w.]+) +import +(\([^)]*\)|[^\n]*)|import +([^\n]*))", re.MULTILINE)


@cache
def cache_root() -> Path:
    """Return the folder of compiled kernels: `CACHE_VARIABLE`, the user's cache, or a temporary folder."""
    base = os.environ.get(CACHE_VARIABLE) or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "wingbeat" / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        pass
    else:
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.gettempdir()) / f"wingbeat-kernels-{os.getuid()}"


@cache
def imported_files(path: Path) -> frozenset[Path]:
    """Return the files of the project that the text of ``path`` imports directly."""
    return frozenset(_imported(path))


def _imported(path: Path) -> Iterator[Path]:
    for module, names, modules in _IMPORT.findall(path.read_text(encoding="utf-8")):
        for name in [module] if module else re.findall(r"[\w.]+", modules):
            file = _file_of(name)
            if file is None:
                continue
            yield file
            if module and file.name == "__init__.py":  # of a package the names may be modules
                for part in re.findall(r"\w+", names):
                    inside = _file_of(f"{module}.{part}")
                    if inside is not None:
                        yield inside


@cache
def _file_of(name: str) -> Path | None:
    parts = name.split(".")
    if parts[0] not in PACKAGES:
        return None
    path = _ROOT.joinpath(*parts)
    files = path.with_suffix(".py"), path / "__init__.py"
    return next((file for file in files if file.is_file()), None)


@cache
def dependencies(path: Path) -> tuple[Path, ...]:
    """Return ``path`` and the files of the project that it imports, directly or indirectly; sorted."""
    found: set[Path] = set()
    pending = [path]
    while pending:
        file = pending.pop()
        if file not in found:
            found.add(file)
            pending.extend(imported_files(file) - found)
    return tuple(sorted(found))


@cache
def _digest_of_file(path: Path) -> bytes:
    """Digest of a file's name in the project and its contents."""
    name = path.relative_to(_ROOT).as_posix() if path.is_relative_to(_ROOT) else path.name
    return hashlib.sha256(name.encode() + b"\0" + path.read_bytes()).digest()


@cache
def source_digest(path: Path) -> str:
    """Return the digest of `dependencies` and of this package, 16 hexadecimal digits."""
    files = sorted({*dependencies(path), *_DECORATORS})
    return hashlib.sha256(b"".join(map(_digest_of_file, files))).hexdigest()[:16]


def file_folder(path: Path) -> Path:
    """Return the folder of all kernels of one file: a subfolder for the present digest, and its path in `_MARK`."""
    return cache_root() / f"{path.stem}-{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"


def create_folder(source: Path) -> None:
    """Create the folder of the present state of ``source`` and remove those of its earlier states."""
    folder = file_folder(source)
    present = folder / source_digest(source)
    if not present.is_dir():
        present.mkdir(parents=True, exist_ok=True)
        (folder / _MARK).write_text(str(source), encoding="utf-8")
        for other in folder.iterdir():
            if other.is_dir() and other != present:
                shutil.rmtree(other, ignore_errors=True)
        _remove_orphans()


@cache
def _remove_orphans() -> None:
    """Remove the kernels of files that no longer exist, once in a process."""
    for folder in cache_root().iterdir():
        try:
            orphan = not Path((folder / _MARK).read_text(encoding="utf-8")).exists()
        except OSError:
            # Made by a version without the mark, or by another process at this moment.
            orphan = folder.is_dir() and time.time() - folder.stat().st_mtime > UNMARKED_AGE
        if orphan:
            shutil.rmtree(folder, ignore_errors=True)


def use_public_cache() -> None:
    """Give numba's own cache a folder for the present state of all sources: its key knows one file only."""
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    digest = hashlib.sha256()
    for package in PACKAGES:
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.read_bytes())
    plain = cache_root() / "plain"
    folder = plain / digest.hexdigest()[:16]
    if not folder.is_dir():
        shutil.rmtree(plain, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        (plain / _MARK).write_text(str(_ROOT), encoding="utf-8")
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]


def is_compiled(function: Callable[..., object]) -> bool:
    """Return whether the cache holds a compiled form of a kernel; otherwise the first call compiles it."""
    stats = getattr(function, "stats", None)
    if stats is None:
        return True  # not compiled at all, see `mode.WITHOUT_JIT`
    stem = Path(inspect.getfile(function.py_func)).stem  # type: ignore[attr-defined]
    return any(Path(stats.cache_path).glob(f"{stem}.{function.__name__}-*.nbi"))
