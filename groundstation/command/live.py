"""``--live``: a recording shown to Foxglove and Lichtblick while it grows."""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from avionics.quantities import counted
from logs.live.server import HOST, PORT, LiveServer, parse_address


def add_live(parser: argparse.ArgumentParser) -> None:
    """Offer ``--live``, with or without an address."""
    parser.add_argument(
        "--live",
        nargs="?",
        const=f"{HOST}:{PORT}",
        metavar="HOST:PORT",
        help=f"show it to Foxglove and Lichtblick while it goes on, at ws://HOST:PORT ({HOST}:{PORT}; port 0: any)",
    )


@contextlib.contextmanager
def shown_live(address: str | None, paths: Sequence[Path]) -> Iterator[LiveServer | None]:
    """Show the files at an address, told on stderr, as long as the context lasts; nothing without an address.

    Raises:
        BadInput: no such address, foxglove-sdk is not installed, or the port is in use.
    """
    if address is None:
        yield None
        return
    with LiveServer(parse_address(address), paths) as server:
        print(f"live: open {server.url} in Foxglove or Lichtblick", file=sys.stderr, flush=True)
        yield server
    for line in _shortfall(server):
        print(line, file=sys.stderr)


def _shortfall(server: LiveServer) -> list[str]:
    """What was not shown, in words."""
    skipped = counted(server.skipped, "message")
    lines = [f"live: {skipped} not shown: too many at once; they are in the log"] if server.skipped else []
    return lines + ([f"live: ended early: {server.failure}"] if server.failure else [])
