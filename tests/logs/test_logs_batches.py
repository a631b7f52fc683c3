"""Messages that are handed over some hundred at a time: all of them, once, in turn, whatever ends the flight."""

from __future__ import annotations

from typing import Any

import pytest
from recorded import flight

from logs.batches import BATCH, batched
from wingbeat.topic import Topic

MESSAGES = flight(2.0)


def test_all_arrive_in_turn_and_none_is_held_longer_than_a_batch() -> None:
    arrived: list[tuple[Topic, Any]] = []
    sizes: list[int] = []

    def record_all(messages: Any) -> None:
        arrived.extend(messages)
        sizes.append(len(messages))

    with batched(record_all) as publish:
        for said, (topic, message) in enumerate(MESSAGES, 1):
            publish(topic, message)
            assert said - len(arrived) < BATCH
    assert arrived == MESSAGES
    assert set(sizes[:-1]) == {BATCH} and 0 < sizes[-1] <= BATCH


def test_a_flight_that_fails_leaves_what_it_said() -> None:
    arrived: list[tuple[Topic, Any]] = []
    with pytest.raises(ZeroDivisionError), batched(arrived.extend) as publish:
        for topic, message in MESSAGES[:10]:
            publish(topic, message)
        raise ZeroDivisionError
    assert arrived == MESSAGES[:10]


def test_an_interruption_while_a_batch_is_recorded_has_none_recorded_twice() -> None:
    arrived: list[tuple[Topic, Any]] = []

    def interrupted(messages: Any) -> None:
        arrived.extend(messages)
        if len(arrived) == BATCH:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), batched(interrupted) as publish:
        for topic, message in MESSAGES:
            publish(topic, message)
    assert arrived == MESSAGES[:BATCH]
