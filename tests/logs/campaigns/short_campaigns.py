"""Campaigns of short flights for the tests, and a cluster that lives in the test's own process."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from logs.campaigns.campaign import Campaign, load_campaign

HEAD = "name = 'short'\n"
SHORT = "[flight]\nduration = 0.5\n"
"""so short that the vehicle is never launched, which takes a twentieth of a second"""


def campaign_of(folder: Path, text: str, name: str = "short.toml") -> Campaign:
    """The campaign of a file with that text."""
    path = folder / name
    path.write_text(text)
    return load_campaign(path)


@contextlib.contextmanager
def cluster_in_process(workers: int = 1) -> Iterator[Any]:
    """A Dask client whose workers are threads of this process; skips the test where Dask is not installed."""
    distributed = pytest.importorskip("distributed")
    with distributed.Client(
        processes=False, n_workers=workers, threads_per_worker=1, dashboard_address=None
    ) as client:
        yield client
