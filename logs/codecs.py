"""Encoders of messages by kind of topic; decoders without fixed layout."""

from __future__ import annotations

import functools
import json
import struct
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from google.protobuf.message_factory import GetMessageClass
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from numpy.typing import NDArray

from logs.layout import Layout, layout_of
from logs.records import Damage
from logs.ros2 import cdr_decoder
from logs.schema import channel_metadata, descriptor_set
from wingbeat.message import Event, Severity, Text
from wingbeat.topic import Topic

_HEAD = struct.Struct("<BQHIQQ")
_HEAD_BODY = _HEAD.size - 9
STAMP_OFFSET = 11
"""bytes before the stamp of a message record: sequence number, log time and publish time"""
_JSON, _PROTOBUF = ("json", "jsonschema"), ("protobuf", "protobuf")
"""encodings of the messages and of their schema"""
TEXT_SCHEMA = {
    "title": "wingbeat.avionics.Text",
    "type": "object",
    "properties": {"time_us": {"type": "integer"}, "text": {"type": "string"}},
}
DOCUMENT_SCHEMA = {
    "title": "wingbeat.Document",
    "type": "object",
    "properties": {"time_us": {"type": "integer"}},
}
_LEVELS = {
    Severity.DEBUG: FoxgloveLog.DEBUG,
    Severity.INFO: FoxgloveLog.INFO,
    Severity.NOTICE: FoxgloveLog.INFO,
    Severity.WARNING: FoxgloveLog.WARNING,
    Severity.ERROR: FoxgloveLog.ERROR,
}


class Stamped(NamedTuple):
    """Serialized protobuf message for a topic with a protobuf class, as used by viewers."""

    time_us: int
    """us; since boot"""
    body: bytes
    """-; the serialized message; viewers' messages are rebuilt in the same object"""


class Document(NamedTuple):
    """Message with keys that only its sender defines, for a topic of JSON."""

    time_us: int
    """us; since boot"""
    values: Mapping[str, Any]
    """-; values of JSON types"""


class Codec(NamedTuple):
    """Schema, channel and encoder of a topic."""

    schema: Schema
    channel: Channel
    record: Callable[[Any], bytes]
    """message to its record, with zeros in the stamp and in the bytes of the template; without a template the stamp
    contains the time in us"""
    pack: Callable[..., bytes] | None = None
    """`record` of the fields of a message as separate arguments; None if one is an array or has no constant width"""
    template: Template | None = None
    """None if the messages differ in length"""

    @property
    def time_offset(self) -> int:
        """Bytes before the time in us, 8 bytes, in what `record` returns."""
        return STAMP_OFFSET + 4 if self.template is None else self.template.time_offset


class Template:
    """Constant bytes of the records of a topic with constant layout: header and tags."""

    def __init__(self, layout: Layout, channel: int) -> None:
        tags = b"".join(field.tag + bytes(struct.calcsize(f"<{field.code}")) for field in layout.fields)
        self.record = _HEAD.pack(Opcode.MESSAGE, _HEAD_BODY + len(tags), channel, 0, 0, 0) + tags
        self._type = layout.record_type(_HEAD.size)
        self._fields = layout.fields
        self.time_offset: int = self._type.fields["time_us"][1]  # type: ignore[index]

    def rows(self, columns: Sequence[NDArray[Any]]) -> NDArray[np.uint8]:
        """Encode columns (n,) or (n, k), one for each field; return the records (n, size) with stamps of zero.

        Raises:
            ValueError: an integer field has another value after the conversion to its type.
        """
        rows = np.empty((len(columns[0]), len(self.record)), np.uint8)
        rows[:] = np.frombuffer(self.record, np.uint8)
        table = rows.view(self._type)[:, 0]
        for field, values in zip(self._fields, columns, strict=True):
            table[field.name] = values
            made = table[field.name]
            if (
                made.dtype.kind in "iu"
                and not np.can_cast(values.dtype, made.dtype)
                and not np.array_equal(made, values)
            ):
                raise ValueError(f"{field.name} is not of type {field.scalar}")
        return rows


@functools.lru_cache(maxsize=256)
def codec_for(topic: Topic[Any]) -> Codec:
    """Return schema, channel and encoder of a topic; both numbers are ``topic.channel``.

    Raises:
        TypeError: the message has a field without a fixed width.
    """
    metadata = {"rate": f"{topic.rate:g}", "deterministic": str(topic.deterministic).lower()}
    message = topic.message
    if message is Text:
        return _free(topic, metadata, _JSON, TEXT_SCHEMA["title"], _json(TEXT_SCHEMA), encode_text)  # type: ignore[arg-type]
    if message is Document:
        return _free(topic, metadata, _JSON, str(DOCUMENT_SCHEMA["title"]), _json(DOCUMENT_SCHEMA), encode_document)
    if message is Event or issubclass(message, Protobuf):
        made, encoder = (FoxgloveLog, encode_event) if message is Event else (message, attrgetter("body"))
        return _free(topic, metadata, _PROTOBUF, made.DESCRIPTOR.full_name, file_descriptors(made), encoder)
    layout = layout_of(message)  # type: ignore[arg-type]
    schema, channel = _declare(
        topic, metadata | channel_metadata(layout), _PROTOBUF, layout.name, descriptor_set(layout)
    )
    return Codec(schema, channel, *_fixed(layout), Template(layout, topic.channel))


def _json(schema: Mapping[str, Any]) -> bytes:
    return json.dumps(schema).encode()


def _declare(
    topic: Topic[Any], metadata: dict[str, str], encodings: tuple[str, str], name: str, data: bytes
) -> tuple[Schema, Channel]:
    schema = Schema(id=topic.channel, name=name, encoding=encodings[1], data=data)
    return schema, Channel(topic.channel, topic.name, encodings[0], metadata, topic.channel)


def file_descriptors(message: type[Protobuf]) -> bytes:
    """Return the serialized FileDescriptorSet of a generated message class with all imports."""
    out = FileDescriptorSet()
    seen: set[str] = set()

    def add(file: Any) -> None:
        if file.name in seen:
            return
        seen.add(file.name)
        for dependency in file.dependencies:
            add(dependency)
        file.CopyToProto(out.file.add())

    add(message.DESCRIPTOR.file)
    return out.SerializeToString(deterministic=True)


def _fixed(layout: Layout) -> tuple[Callable[[Any], bytes], Callable[..., bytes] | None]:
    """Return encoders of a fixed layout for a message and for its fields: one `struct` call packs the values.

    Bytes of header and tags are zero, because as arguments they would take as long as the values.
    """
    values = "".join(f"{len(field.tag)}x{field.code}" for field in layout.fields)
    pack = struct.Struct(f"<{_HEAD.size}x{values}").pack
    arrays = [bool(field.length) for field in layout.fields]
    if not any(arrays):
        return lambda message: pack(*message), pack

    def encode(message: Any) -> bytes:
        flat: list[Any] = []
        for is_array, value in zip(arrays, message, strict=True):
            if is_array:
                flat += value
            else:
                flat.append(value)
        return pack(*flat)

    return encode, None


def _free(
    topic: Topic[Any],
    metadata: dict[str, str],
    encodings: tuple[str, str],
    name: str,
    data: bytes,
    encode: Callable[[Any], bytes],
) -> Codec:
    def encode_record(message: Any) -> bytes:
        body = encode(message)
        return _HEAD.pack(Opcode.MESSAGE, _HEAD_BODY + len(body), topic.channel, 0, message.time_us, 0) + body

    return Codec(*_declare(topic, metadata, encodings, name, data), encode_record)


def encode_text(message: Text) -> bytes:
    """Encode a text message as JSON with its time."""
    return json.dumps({"time_us": message.time_us, "text": message.text}, separators=(",", ":")).encode()


def encode_document(message: Document) -> bytes:
    """Encode a document as JSON with its time.

    Raises:
        ValueError: a number that is not finite.
    """
    document = {"time_us": message.time_us, **message.values}
    return json.dumps(document, separators=(",", ":"), allow_nan=False).encode()


def decode_text(data: bytes) -> Text:
    """Inverse of `encode_text`.

    Raises:
        Damage: the bytes are not such a document.
    """
    try:
        document = json.loads(data)
        return Text(int(document["time_us"]), str(document["text"]))
    except (ValueError, KeyError, TypeError, RecursionError):
        raise Damage("a text message cannot be read") from None


MAX_EVENT_BYTES = 1 << 20
MAX_EVENT_TEXT = 4000
"""-; characters of an event that are kept: a traceback has fewer"""


def encode_event(message: Event) -> bytes:
    """Encode a ``foxglove.Log``; its time stamp is since boot, ``name`` is the source, ``file`` the MAVLink
    severity.
    """
    seconds, rest = divmod(message.time_us, 1_000_000)
    severity = Severity(message.severity)
    log = FoxgloveLog(level=_LEVELS.get(severity, FoxgloveLog.FATAL), message=message.text, name=message.source)
    log.file = severity.name
    log.timestamp.seconds = seconds
    log.timestamp.nanos = rest * 1000
    return bytes(log.SerializeToString(deterministic=True))


def decode_event(data: bytes) -> Event:
    """Decode a ``foxglove.Log``; a message of another writer gets the severity of its level.

    Raises:
        Damage: the bytes are no ``foxglove.Log``, or longer than any text for people.
    """
    if len(data) > MAX_EVENT_BYTES:
        raise Damage(f"an event has {len(data)} bytes")
    try:
        log = FoxgloveLog.FromString(data)
    except DecodeError:
        raise Damage("an event cannot be read") from None
    time_us = log.timestamp.seconds * 1_000_000 + log.timestamp.nanos // 1000
    return Event(time_us, _severity(log), _shown(log.name), _shown(log.message))


def _shown(text: str) -> str:
    return text if len(text) <= MAX_EVENT_TEXT else f"{text[:MAX_EVENT_TEXT]}… ({len(text)} characters)"


def _severity(log: FoxgloveLog) -> Severity:
    if log.file in Severity.__members__:
        return Severity[log.file]
    levels = {level: severity for severity, level in reversed(_LEVELS.items())}
    return levels.get(log.level, Severity.CRITICAL if log.level == FoxgloveLog.FATAL else Severity.INFO)


# --- messages of other writers --------------------------------------------------------------------------


def value_decoder(channel: Channel, schema: Schema | None) -> Callable[[bytes], dict[str, Any]]:
    """Return the decoder of a message to its values; members of nested messages are named ``outer.inner``.

    Raises:
        InputError: ROS 2, and the package that decodes it is not installed.
        Damage: neither JSON, nor protobuf or ROS 2 with a whole schema.
    """
    if channel.message_encoding == "json":
        return _decode_json
    if channel.message_encoding == "cdr" and schema is not None and schema.encoding == "ros2msg":
        return cdr_decoder(channel, schema)
    if channel.message_encoding != "protobuf" or schema is None or schema.encoding != "protobuf":
        raise Damage(f"{channel.topic} is encoded as {channel.message_encoding or 'nothing known'}")
    kind = _message_class(schema)

    def decode(data: bytes) -> dict[str, Any]:
        try:
            return dict(_values(kind.FromString(data), ""))
        except (DecodeError, RecursionError):
            raise Damage(f"a message of {channel.topic} cannot be read") from None

    return decode


def _message_class(schema: Schema) -> type[Protobuf]:
    pool = DescriptorPool()
    try:
        for file in _dependencies_first(FileDescriptorSet.FromString(schema.data)):
            pool.AddSerializedFile(file)
        return GetMessageClass(pool.FindMessageTypeByName(schema.name))
    except (DecodeError, TypeError, KeyError, ValueError):
        raise Damage(f"schema {schema.name} cannot be read") from None


def _dependencies_first(files: FileDescriptorSet) -> list[bytes]:
    by_name = {file.name: file for file in files.file}
    out: dict[str, bytes] = {}

    def add(name: str) -> None:
        file = by_name.pop(name, None)
        if file is None:
            return
        for dependency in file.dependency:
            add(dependency)
        out[name] = file.SerializeToString()

    for name in list(by_name):
        add(name)
    return list(out.values())


def _decode_json(data: bytes) -> dict[str, Any]:
    try:
        document = json.loads(data)
        return dict(_members(document, "")) if isinstance(document, dict) else {"value": document}
    except (ValueError, RecursionError):
        raise Damage("a JSON message cannot be read") from None


def _members(document: Mapping[str, Any], prefix: str) -> Any:
    for key, value in document.items():
        if isinstance(value, dict):
            yield from _members(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _values(message: Protobuf, prefix: str) -> Any:
    for field in message.DESCRIPTOR.fields:
        value = getattr(message, field.name)
        if field.type != FieldDescriptor.TYPE_MESSAGE:
            yield prefix + field.name, list(value) if field.is_repeated else value
        elif field.is_repeated:
            yield prefix + field.name, [dict(_values(item, "")) for item in value]
        else:
            yield from _values(value, f"{prefix}{field.name}.")
