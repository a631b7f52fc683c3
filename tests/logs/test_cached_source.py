"""Topics of a log that an identification reads in one pass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from recorded import flight, record

from avionics import topics
from logs.identification.sources.topic_table import CachedSource
from logs.reader import Log, open_log
from logs.records import records
from wingbeat.errors import InputError

SEVERAL = (topics.IMU, topics.ATTITUDE, topics.WING)


def test_several_topics_are_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a log without one of the topics THEN the others are read in one pass, the same columns."""
    log = open_log(record(tmp_path / "a.mcap", [one for one in flight(1.0) if one[0] is not topics.WING]))
    expected = log.columns(topics.IMU)
    source = CachedSource(log)
    source.read_together(SEVERAL)
    monkeypatch.setattr(Log, "tables", None)
    assert np.array_equal(source.columns(topics.IMU)["accel_x"], expected["accel_x"])
    assert len(source.columns(topics.ATTITUDE)["pitch"])


def test_a_damaged_part_is_reported_by_the_topic_that_is_needed(tmp_path: Path) -> None:
    path = record(tmp_path / "a.mcap", flight(1.0))
    data = bytearray(path.read_bytes())
    chunks = [span for span in records(bytes(data), 8, len(data)) if span.opcode == Opcode.CHUNK]
    data[chunks[0].end - 100] ^= 0xFF
    (tmp_path / "b.mcap").write_bytes(data)
    source = CachedSource(open_log(tmp_path / "b.mcap"))
    source.read_together(SEVERAL)
    with pytest.raises(InputError, match="chunk"):
        source.columns(topics.IMU)
