"""A flight as another program might have logged it: one table of columns, brought back by a mapping."""

from __future__ import annotations

import csv
from pathlib import Path

from memory_log import MemoryLog

from avionics import topics
from logs.export import Part, export
from logs.importing.log_import import Choice, import_log
from logs.reader import open_log
from logs.recorder import McapRecorder
from wingbeat.topic import Topic

RATE = 200.0
"""Hz; of the table"""
MEASURED: dict[Topic, tuple[str, ...]] = {
    topics.IMU: ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"),
    topics.ATTITUDE: ("roll", "pitch", "bias_x", "bias_y", "bias_z"),
    topics.AIR_DATA: ("airspeed",),
    topics.ALTITUDE: ("climb_rate",),
    topics.ACTUATORS: ("elevator",),
    topics.WING: ("phase", "angle_left", "angle_right"),
}
"""what stands in the table: no topic tells of an excitation"""


def as_table(log: MemoryLog, start: float, table: Path) -> Path:
    """Write what was measured from ``start`` (s since boot) on as one CSV file."""
    recording = table.with_suffix(".mcap")
    with McapRecorder(recording, start_epoch_ns=0) as recorder:
        messages = ((topic, message) for topic in MEASURED for message in log.messages[topic.name])
        for topic, message in sorted(messages, key=lambda pair: pair[1].time_us):
            if message.time_us >= start * 1e6:
                recorder.record(topic, message)
    with open_log(recording) as opened:
        wanted = [f"{topic.name}.{field}" for topic, fields in MEASURED.items() for field in fields]
        export(opened, table, Part(wanted, rate=RATE))
    return table


def mapping(table: Path) -> str:
    """What the columns of the table are; their names tell the unit."""
    with table.open(newline="") as file:
        names = next(csv.reader(file))
    lines = ["[time]", f'column = "{names[0]}"']
    for topic, fields in MEASURED.items():
        lines.append(f'[topics."{topic.name}"]')
        for field in fields:
            column = next(name for name in names if name.startswith(f"{topic.name}.{field} ["))
            lines.append(f'{field} = {{ column = "{column}", unit = "{column.rpartition("[")[2][:-1]}" }}')
    return "\n".join(lines)


def imported(table: Path) -> Path:
    """The table as a log again."""
    chosen, out = table.with_suffix(".toml"), table.with_name("imported.mcap")
    chosen.write_text(mapping(table))
    assert import_log(Choice(table, out, chosen)).dropped == ()
    return out
