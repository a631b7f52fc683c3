"""Types that messages are declared with, and the messages that every package records.

Each field's docstring begins with its unit (``-`` for none). Earth axes are NED, body axes FRD; SI and radians,
another unit only as a suffix of the name. Time stamps are microseconds since boot. The type of a field is
its width in the log: ``float`` is 8 bytes, the aliases below name the others.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, NamedTuple


class Wire(NamedTuple):
    """The protobuf scalar a field is logged as, and the length of an array (0 for a single value)."""

    scalar: str
    length: int = 0


Time = Annotated[int, Wire("fixed64")]
Counts = Annotated[int, Wire("sfixed32")]
Number = Annotated[int, Wire("fixed32")]
Large = Annotated[int, Wire("fixed64")]


class Severity(IntEnum):
    """MAVLink's severities."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7


class Event(NamedTuple):
    """Something that happened, for people: STATUSTEXT on the link, a log line in the file."""

    time_us: int
    """us; since boot"""
    severity: Severity
    """-; MAVLink severity"""
    source: str
    """-; name of the module"""
    text: str
    """-; one line"""


class RecorderStatus(NamedTuple):
    """Counters of a recorder, published each time another message is left out."""

    time_us: Time
    """us; since boot"""
    dropped: Number
    """-; messages for which the disk was too slow"""
    refused: Number
    """-; messages, documents and notes that could not be written as they were"""
    waiting: Large
    """bytes; that waited for the disk just then"""
    written: Large
    """bytes; in all files of the recording"""


class Text(NamedTuple):
    """A document in the log: an input, a State snapshot; not of fixed layout."""

    time_us: int
    """us; since boot"""
    text: str
    """-; JSON"""
