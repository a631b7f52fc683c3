"""``--live``: a growing recording served to Foxglove and Lichtblick."""

from __future__ import annotations

import argparse
import contextlib
import itertools
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from logs.live.follower import is_recorded
from logs.live.server import ALONE, HOST, PORT, LiveServer, parse_address
from logs.new_files import numbered
from wingbeat.errors import InputError
from wingbeat.text import pluralize
from wingbeat.topic import Topic

LOOK = 0.1
"""s; interval of checks whether a file is still being recorded"""


def add_live(parser: argparse.ArgumentParser) -> None:
    """Add ``--live``, with or without an address."""
    parser.add_argument(
        "--live",
        nargs="?",
        const=f"{HOST}:{PORT}",
        metavar="HOST:PORT",
        help=f"serve it live to Foxglove and Lichtblick at ws://HOST:PORT (default: {HOST}:{PORT}; port 0: any)",
    )


def add_address(parser: argparse.ArgumentParser) -> None:
    """Add ``--at``."""
    parser.add_argument(
        "--at",
        default=f"{HOST}:{PORT}",
        metavar="HOST:PORT",
        help=f"address for viewers (default: {HOST}:{PORT}; port 0: any)",
    )


@contextlib.contextmanager
def shown_live(
    address: str | None, paths: Sequence[Path], topics: Iterable[Topic[Any]] | None = None
) -> Iterator[LiveServer | None]:
    """Serve the files to viewers at an address while the context lasts; without an address do nothing.

    The address is printed on stderr. ``topics`` (default: all of Wingbeat) are advertised from the start.

    Raises:
        InputError: no such address, foxglove-sdk is not installed, or the port is in use.
    """
    if address is None:
        yield None
        return
    with LiveServer(parse_address(address), paths, topics) as server:
        print(f"live: open {server.url} in Foxglove or Lichtblick", file=sys.stderr, flush=True)
        yield server
    for line in _shortfall(server):
        print(line, file=sys.stderr)


def follow(path: Path, address: str) -> None:
    """Serve a file while another process records it, and then its continuation files.

    Raises:
        InputError: it is not being recorded, or as of `shown_live`.
    """
    present = recorded_file(path)
    if present is None:
        raise InputError(f"{path} is not being recorded: open the file in Foxglove or Lichtblick")
    while present is not None:
        with shown_live(address, [present], ALONE):
            while is_recorded(present):
                time.sleep(LOOK)
        present = recorded_file(path)


def recorded_file(path: Path) -> Path | None:
    """Return the file of a recording (``path``, ``-2``, ``-3`` ...) that is being recorded.

    Raises:
        InputError: one of them cannot be read.
    """
    files = itertools.chain([path], itertools.takewhile(Path.exists, itertools.islice(numbered(path), 1, None)))
    return next((file for file in files if is_recorded(file)), None)


def _shortfall(server: LiveServer) -> list[str]:
    """Return the text about messages that were not shown."""
    skipped = pluralize(server.skipped, "message")
    lines = [f"live: {skipped} not shown (too many at once); they are in the log"] if server.skipped else []
    return lines + ([f"live: ended early: {server.failure}"] if server.failure else [])
