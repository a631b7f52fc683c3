"""Campaigns: many flights of a sweep in one table."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from logs.campaigns.campaign import load_campaign
from logs.campaigns.run import order_of
from logs.campaigns.single_flight import fly_one

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["campaign"]


def campaign(
    file: Path | str, *, workers: int = 1, on_progress: Callable[[int, int], None] = lambda done, of: None
) -> pd.DataFrame:
    """Fly a campaign file and return one row per flight: its values, outcome and metrics (needs pandas).

    ``wingbeat campaign`` also resumes, records and runs on a cluster.

    Args:
        file: campaign, see docs/reference/campaigns.md.
        workers: number of processes.
        on_progress: called with the flights done and their number.

    Raises:
        InputError: the file is not valid.
    """
    import pandas as pd

    chosen = load_campaign(Path(file))
    orders = [order_of(chosen, number) for number in range(1, chosen.size + 1)]
    rows: list[dict[str, Any]] = []
    with _mapped(workers) as mapped:
        for order, row in zip(orders, mapped(fly_one, orders), strict=True):
            rows.append({**order.values, **row})
            on_progress(len(rows), len(orders))
    return pd.DataFrame(rows).set_index("flight")


@contextmanager
def _mapped(workers: int) -> Iterator[Any]:
    if workers <= 1:
        yield map
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield pool.map
