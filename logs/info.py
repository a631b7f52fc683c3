"""Contents of a log: vehicle, duration, topics with rates and gaps, events."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from avionics import topics
from logs.log_file import TopicInfo
from logs.names import JOINED
from logs.reader import Log
from logs.summary import FlightSummary, summarize
from sim_bridge import topics as truth_topics

USUAL = 0.75
"""-; quantile of the periods that are no gaps: if a quarter or more are long, long periods are normal for the topic
"""
GAP_PERIODS = 1.5
"""A pause between two messages longer than this many periods is a gap."""

SUMMED_UP = 2_000_000
"""messages; limit above which the flight is summarized on request only: 2,000,000 messages take a second"""
SUMMED_UP_BYTES = 256 << 20
"""bytes, uncompressed; limit above which the flight is summarized on request only"""
_TOLD_BY = (truth_topics.STATE, topics.NAVIGATION)
"""topics that show whether the vehicle is airborne"""


def summary(log: Log, flight: FlightSummary | None = None) -> dict[str, Any]:
    """Return everything ``wingbeat log info`` shows, ready for JSON; ``flight`` is that of `flight_summary`.

    Keys: ``file``, ``complete``, ``damage`` (lines), ``incomplete`` (damage of the parts of a joined recording, by
    part name), ``flight`` (see `FlightSummary`), ``vehicle`` (None if not recorded), ``start_epoch_ns``, ``duration``
    (s), ``messages``, ``dropped`` (messages), ``topics`` (see `topic_row`), ``events`` (``time`` in s, ``severity``,
    ``source``, ``text``), ``attachments`` (``name``, ``media_type``, ``bytes``), ``metadata``, ``undecodable``
    (messages that cannot be decoded, by topic, of the topics read for this summary).

    Raises:
        InputError: a part of the file is damaged.
    """
    rows = [topic_row(info, log.times(name)) for name, info in log.topics.items()]
    events = log.events()
    return {
        "file": str(log.path),
        "complete": log.complete,
        "damage": list(log.damage),
        "incomplete": log.metadata.get(JOINED, {}),
        "vehicle": vehicle(log),
        "start_epoch_ns": log.boot_ns,
        "duration": log.duration,
        "messages": sum(info.messages for info in log.topics.values()),
        "dropped": dropped(log),
        "flight": _plain(flight),
        "topics": rows,
        "events": [
            {"time": time_us * 1e-6, "severity": severity.name, "source": source, "text": text}
            for time_us, severity, source, text in events
        ],
        "attachments": [
            {"name": item.name, "media_type": item.media_type, "bytes": len(item.data)} for item in log.attachments
        ],
        "metadata": log.metadata,
        "undecodable": log.undecodable,
    }


def flight_summary(log: Log, however_long: bool = False) -> FlightSummary | None:
    """Return the flight summary of a log.

    None if the log contains no flight, or if the log is long and ``however_long`` is False.

    Raises:
        InputError: a part of the file is damaged.
    """
    told = any(log.is_native(topic) for topic in _TOLD_BY)
    return summarize(log) if told and (however_long or not is_long(log)) else None


def _plain(value: Any) -> Any:
    """Named tuples as objects by their fields."""
    fields = getattr(value, "_fields", None)
    return value if fields is None else {name: _plain(getattr(value, name)) for name in fields}


def is_long(log: Log) -> bool:
    """Return whether the flight of a log is summarized on request only."""
    messages = sum(info.messages for info in log.topics.values())
    return messages > SUMMED_UP or log.uncompressed_bytes > SUMMED_UP_BYTES


def vehicle(log: Log) -> str | None:
    """Return the vehicle name in any metadata record with the key ``vehicle``."""
    return next((values["vehicle"] for values in log.metadata.values() if "vehicle" in values), None)


def dropped(log: Log) -> int:
    """Return the number of messages that the recorders dropped because the disk was too slow."""
    recorders = [topic for topic in (topics.RECORDER, truth_topics.RECORDER) if log.is_native(topic)]
    return sum(int(log.columns(topic)["dropped"].max(initial=0)) for topic in recorders)


def topic_row(info: TopicInfo, times: NDArray[np.float64]) -> dict[str, Any]:
    """Return the row of one topic.

    Keys: ``topic``, ``message``, ``messages``, ``nominal_rate`` and ``rate`` (Hz), ``gaps``, ``longest_gap`` (s).
    The measured rate is that of the median period; rate and gaps are None if they cannot be computed.
    """
    row: dict[str, Any] = {
        "topic": info.name,
        "message": info.schema,
        "messages": info.messages,
        "nominal_rate": info.rate,
        "rate": None,
        "gaps": None,
        "longest_gap": None,
    }
    if len(times) < 2 or info.rate == 0.0:
        return row
    periods = np.diff(times)
    median = float(np.median(periods))
    if median > 0.0:
        usual = float(np.percentile(periods, 100.0 * USUAL))
        gaps = periods[periods > GAP_PERIODS * max(usual, median)]
        row |= {"rate": 1.0 / median, "gaps": len(gaps), "longest_gap": float(gaps.max(initial=0.0))}
    return row
