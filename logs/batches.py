"""Batches of messages for a recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from logs.recorder import Said
from wingbeat.topic import Publish, Topic

BATCH = 512
"""-; messages in a batch: a fifth of a second of all topics of a flight"""


@contextmanager
def batched(record_all: Callable[[Sequence[Said]], None]) -> Iterator[Publish]:
    """Record messages in batches of `BATCH`; the remainder is recorded at the end of the context.

    For flights in one process. Batches are faster than single messages because the recorder's data stay in the
    processor cache. Messages must not change after they are published.
    """
    said: list[Said] = []

    def publish(topic: Topic[Any], message: Any) -> None:
        said.append((topic, message))
        if len(said) >= BATCH:
            hand_over()

    def hand_over() -> None:
        nonlocal said
        # A new list first: an interruption must not record a message twice.
        messages, said = said, []
        record_all(messages)

    try:
        yield publish
    finally:
        hand_over()
