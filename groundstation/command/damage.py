"""Messages about damaged logs."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from logs.reader import Log
from wingbeat.errors import InputError


@contextmanager
def damage_notices(logs: Sequence[Log], done: str) -> Iterator[None]:
    """Report the damage of the logs on stderr, a line each; ``done`` is the verb, such as "identified".

    Only the intact data of these logs are used.

    Raises:
        InputError: an error of the block, extended by the damage, which may be its cause.
    """
    try:
        yield
    except InputError as error:
        wrong = "; ".join(f"{log.path}: {'; '.join(log.damage)}" for log in logs if log.damage)
        if not wrong:
            raise
        raise InputError(f"{error} (damaged: {wrong})") from None
    for log in logs:
        if log.damage:
            print(f"wingbeat: {log.path}: {'; '.join(log.damage)}; readable data were {done}", file=sys.stderr)
