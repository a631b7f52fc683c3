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
"""-; share of the periods that are no gaps however long: where a quarter and more are long, the messages come so"""
GAP_PERIODS = 1.5
"""A pause between two messages longer than this many periods is a gap."""

SUMMED_UP = 2_000_000
"""messages; the flight in a log of more is summed up when it is asked for: it takes a second for each of so many"""
SUMMED_UP_BYTES = 256 << 20
"""bytes, uncompressed; likewise"""
_TOLD_BY = (truth_topics.STATE, topics.NAVIGATION)
"""topics that say whether it is in the air"""


def summary(log: Log, flight: FlightSummary | None = None) -> dict[str, Any]:
    """Everything ``wingbeat log info`` shows, ready for JSON; ``flight`` is what `flight_summary` gives.

    Keys: ``file``, ``complete``, ``damage`` (lines), ``incomplete`` (what was wrong with recordings that it was
    joined of, by their names), ``flight`` (see `FlightSummary`), ``vehicle`` (None when not noted),
    ``start_epoch_ns``, ``duration`` (s), ``messages``, ``dropped`` (messages), ``topics`` (see `topic_row`),
    ``events`` (``time`` in s, ``severity``, ``source``, ``text``), ``attachments`` (``name``, ``media_type``,
    ``bytes``), ``metadata``, ``undecodable`` (messages that cannot be decoded, of the topics that were
    read for this, by topic).

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
    """The flight in a log; None where nothing tells it, or where the log is long and that was not asked for.

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
    """Whether its flight is summed up only when it is asked for."""
    messages = sum(info.messages for info in log.topics.values())
    return messages > SUMMED_UP or log.uncompressed_bytes > SUMMED_UP_BYTES


def vehicle(log: Log) -> str | None:
    """Name of the vehicle as noted in any metadata record under ``vehicle``."""
    return next((values["vehicle"] for values in log.metadata.values() if "vehicle" in values), None)


def dropped(log: Log) -> int:
    """Messages that the recorders had to leave out because the disk was too slow."""
    recorders = [topic for topic in (topics.RECORDER, truth_topics.RECORDER) if log.is_native(topic)]
    return sum(int(log.columns(topic)["dropped"].max(initial=0)) for topic in recorders)


def topic_row(info: TopicInfo, times: NDArray[np.float64]) -> dict[str, Any]:
    """One topic.

    Keys: ``topic``, ``message``, ``messages``, ``nominal_rate`` and ``rate`` (Hz), ``gaps``, ``longest_gap`` (s).
    The measured rate is that of the median period; rate and gaps are None where nothing can be said.
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
