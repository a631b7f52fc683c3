"""A log whose topics are read once, however many methods ask for them."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

from logs.identification.sources.topic_table import ColumnSource
from wingbeat.topic import Topic


class Remembered:
    """The columns of ``source``, kept from the first time that a topic is asked for."""

    def __init__(self, source: ColumnSource) -> None:
        self._source = source
        self._read: dict[str, Mapping[str, Any]] = {}

    @property
    def topics(self) -> Container[str]:
        """Names of the topics that the source has, none where it does not tell them."""
        told: Container[str] = getattr(self._source, "topics", ())
        return told

    def columns(self, topic: Topic[Any]) -> Mapping[str, Any]:
        """Arrays by field name.

        Raises:
            InputError: as the source says.
        """
        if topic.name not in self._read:
            self._read[topic.name] = self._source.columns(topic)
        return self._read[topic.name]
