"""Batches of messages for a recorder."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from logs.recorder import Said
from wingbeat.topic import Publish, Topic

BATCH = 512
"""-; messages: a fifth of a second of a whole flight"""


@contextmanager
def batched(record_all: Callable[[Sequence[Said]], None]) -> Iterator[Publish]:
    """Where messages are said that nobody waits for, as those of a flight in one process.

    They are recorded `BATCH` at a time, what is left at the end; one by one, the recorder looked at each between all
    else that a tick of a flight does. Messages may not change once they are said.
    """
    said: list[Said] = []

    def publish(topic: Topic[Any], message: Any) -> None:
        said.append((topic, message))
        if len(said) >= BATCH:
            hand_over()

    def hand_over() -> None:
        nonlocal said
        # Another list first: an interruption must not have a message recorded twice.
        messages, said = said, []
        record_all(messages)

    try:
        yield publish
    finally:
        hand_over()
