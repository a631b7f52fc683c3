"""Export as rosbag2: an MCAP file with the ros2 profile, written by the ``rosbags`` package.

Every topic keeps its name and its values, in a message of package ``wingbeat_msgs`` (axes NED and FRD, SI), events as
rcl_interfaces/Log, other messages as std_msgs/String with JSON. `STANDARD` adds standard messages in the frames of
REP 103: ``odom`` is ENU, ``base_link`` FLU.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from logs.columns import Columns
from logs.extras import load_extra
from logs.flat import distinct, texts
from logs.layout import SCALARS, Layout
from logs.new_files import claim
from logs.reader import Log
from logs.ros2_standard import STANDARD, Series, stamp
from wingbeat.errors import InputError

PACKAGE = "wingbeat_msgs"
SINGLE = ".mcap"
"""suffix of a target that is the file without the folder of a bag"""
TYPES = {
    "double": "float64", "float": "float32", "fixed32": "uint32", "sfixed32": "int32", "fixed64": "uint64",
    "sfixed64": "int64",
}  # fmt: skip
LEVELS = {0: 10, 1: 10, 2: 20, 3: 30, 4: 40, 5: 50}
"""level of rcl_interfaces/Log by that of foxglove.Log"""
ADVANCE_EVERY = 20_000
"""messages between two calls for the progress bar"""
Show = Callable[[float, float, str], None]
Tables = Mapping[str, Columns]


def write_rosbag2(log: Log, target: Path, tables: Tables, show: Show = lambda done, total, what: None) -> list[Path]:
    """Write tables as a bag: a folder with ``metadata.yaml`` and an MCAP file, or that file alone (``.mcap``).

    Raises:
        InputError: rosbags is not installed, or the target exists or cannot be written.
    """
    writer = load_extra("rosbags.rosbag2", "rosbags", "writing rosbag2")
    store = _typestore()
    series = _series(log, tables)
    for one in series:
        if one.definition is not None and one.kind not in store.types:
            msg = load_extra("rosbags.typesys", "rosbags", "writing rosbag2")
            store.register(msg.get_types_from_msg(one.definition, one.kind))
    try:
        with tempfile.TemporaryDirectory(prefix=f".{target.name}.", dir=target.parent) as folder:
            draft = Path(folder) / target.stem
            bag = writer.Writer(draft, version=9, storage_plugin=writer.StoragePlugin.MCAP)
            bag.set_compression(writer.CompressionMode.STORAGE, writer.CompressionFormat.ZSTD)
            with bag:
                _fill(bag, store, series, show)
            if target.suffix == SINGLE:
                claim(draft / f"{draft.name}.mcap", target)
                return [target]
            draft.rename(target)
    except OSError as error:
        raise InputError(f"cannot write {target}: {error.strerror or error}") from None
    return sorted(target.iterdir())


def _typestore() -> Any:
    system = load_extra("rosbags.typesys", "rosbags", "writing rosbag2")
    return system.get_typestore(system.Stores.ROS2_HUMBLE)


def _fill(bag: Any, store: Any, series: Sequence[Series], show: Show) -> None:
    """Write all messages in order of time."""
    connections = [_connect(bag, store, one) for one in series]
    times = np.concatenate([one.times for one in series]) if series else np.zeros(0, np.int64)
    owners = np.repeat(np.arange(len(series)), [len(one.times) for one in series])
    rows = np.concatenate([np.arange(len(one.times)) for one in series]) if series else owners
    order = np.argsort(times, kind="stable")
    ordered = zip(times[order].tolist(), owners[order].tolist(), rows[order].tolist(), strict=True)
    for done, (time, owner, row) in enumerate(ordered):
        if done % ADVANCE_EVERY == 0:
            show(done, len(times), "writing messages")
        one = series[owner]
        bag.write(connections[owner], time, store.serialize_cdr(one.message(store.types, row), one.kind))


def _connect(bag: Any, store: Any, one: Series) -> Any:
    if one.definition is None:
        return bag.add_connection(one.topic, one.kind, typestore=store)
    return bag.add_connection(one.topic, one.kind, msgdef=one.definition, rihs01=store.hash_rihs01(one.kind))


def _series(log: Log, tables: Tables) -> list[Series]:
    """Return the messages of each topic, then those of `STANDARD` whose source the log has."""
    layouts = {name: log.topics[name].layout for name in tables}
    # Topics of one layout share a type; of two layouts with one name, the second gets a number.
    kinds = list(dict.fromkeys(_kind(layout) for layout in layouts.values() if layout is not None))
    names = dict(zip(kinds, distinct(name for name, _ in kinds), strict=True))
    found = []
    for name, columns in tables.items():
        layout = layouts[name]
        if layout is not None:
            found.append(_flat(columns, layout, f"{PACKAGE}/msg/{names[_kind(layout)]}"))
        elif log.topics[name].schema == "foxglove.Log":
            found.append(_events(columns))
        else:
            found.append(_document(columns))
    taken = [one.topic for one in found]
    for topic, build in STANDARD.items():
        one = build(topic, tables)
        if one is not None and topic not in taken:
            found.append(one)
    return found


# --- our own messages -----------------------------------------------------------------------------------------


def message_text(layout: Layout) -> str:
    """Return the .msg text of a layout: units and descriptions as comments, enumerations as constants."""
    lines = [f"# {line}" for line in layout.description.splitlines()]
    for field, name in zip(layout.fields, member_names(layout), strict=True):
        kind, array = TYPES[field.scalar], f"[{field.length}]" if field.length else ""
        labels = {value: label for value, label in field.labels.items() if value >= 0 or kind.startswith("int")}
        constants = distinct(_constant(f"{name}_{label}") for label in labels.values())
        lines += [f"{kind} {constant}={value}" for constant, value in zip(constants, labels, strict=True)]
        comment = " ".join(f"{field.unit}; {field.description}".split()).rstrip("; ")
        lines.append(f"{kind}{array} {name}  # {comment}")
    return "\n".join([*lines, ""])


def _kind(layout: Layout) -> tuple[str, str]:
    """Return the plain name and the text of a message type."""
    return _type_name(layout.name), message_text(layout)


def member_names(layout: Layout) -> list[str]:
    """Return valid and unique ROS names of the fields: lower case, single underscores."""
    return distinct(_member(field.name) for field in layout.fields)


def _member(name: str) -> str:
    plain = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_") or "value"
    return plain if plain[0].isalpha() else f"field_{plain}"


def _constant(name: str) -> str:
    return re.sub(r"[^A-Z0-9]+", "_", name.upper()).strip("_")


def _type_name(name: str) -> str:
    words = re.split(r"[^A-Za-z0-9]+", name.rpartition(".")[2])
    plain = "".join(word[:1].upper() + word[1:] for word in words) or "Message"
    return plain if plain[0].isalpha() else f"Message{plain}"


def _topic(name: str) -> str:
    parts = [re.sub(r"[^A-Za-z0-9_]", "_", part) for part in name.split("/") if part]
    return "".join(f"/{part if not part[0].isdigit() else '_' + part}" for part in parts) or "/topic"


def _flat(columns: Columns, layout: Layout, kind: str) -> Series:
    names = member_names(layout)
    values = [
        columns[field.name].astype(f"<{SCALARS[field.scalar].code}") if field.length else columns[field.name].tolist()
        for field in layout.fields
    ]

    def message(types: Any, row: int) -> Any:
        return types[kind](**{name: column[row] for name, column in zip(names, values, strict=True)})

    return Series(_topic(columns.topic), kind, message_text(layout), columns.log_time_ns, message)


def _events(columns: Columns) -> Series:
    """Return events as rcl_interfaces/Log."""

    def message(types: Any, row: int) -> Any:
        level = LEVELS.get(int(columns["level"][row]), 20)
        source, file = str(columns["name"][row]), str(columns["file"][row])
        return types["rcl_interfaces/msg/Log"](
            stamp(types, int(columns.log_time_ns[row])), level, source, str(columns["message"][row]), file, "", 0
        )

    return Series(_topic(columns.topic), "rcl_interfaces/msg/Log", None, columns.log_time_ns, message)


def _document(columns: Columns) -> Series:
    """Return messages of varying layout as JSON in a std_msgs/String."""
    cells = {name: texts(values) if values.dtype == object else values.tolist() for name, values in columns.items()}

    def message(types: Any, row: int) -> Any:
        return types["std_msgs/msg/String"](json.dumps({name: values[row] for name, values in cells.items()}))

    return Series(_topic(columns.topic), "std_msgs/msg/String", None, columns.log_time_ns, message)
