"""Encoders of messages by kind of topic; decoders without fixed layout."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any, NamedTuple

from foxglove_schemas_protobuf.Log_pb2 import Log as FoxgloveLog
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message import Message as Protobuf
from google.protobuf.message_factory import GetMessageClass
from mcap.opcode import Opcode
from mcap.records import Channel, Schema

from logs.layout import Layout, layout_of
from logs.records import Damage
from logs.ros2 import cdr_decoder
from logs.schema import channel_metadata, descriptor_set
from wingbeat.message import Event, Severity, Text
from wingbeat.topic import Topic

Encoder = Callable[[Any, int, int], bytes]
"""(message, log time in ns, sequence number) to a complete message record"""
_HEAD = struct.Struct("<BQHIQQ")
_HEAD_BODY = _HEAD.size - 9
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
    encode: Encoder


def codec_for(topic: Topic[Any]) -> Codec:
    """Return schema, channel and encoder of a topic; both numbers are ``topic.channel``.

    Raises:
        TypeError: the message has a field without a fixed width.
    """
    encoding, schema_encoding, name, data, extra, encoder = _kind(topic)
    metadata = {"rate": f"{topic.rate:g}", "deterministic": str(topic.deterministic).lower(), **extra}
    schema = Schema(id=topic.channel, name=name, encoding=schema_encoding, data=data)
    channel = Channel(topic.channel, topic.name, encoding, metadata, topic.channel)
    return Codec(schema, channel, encoder)


def _kind(topic: Topic[Any]) -> tuple[str, str, str, bytes, dict[str, str], Encoder]:
    message = topic.message
    if message is Text:
        schema = json.dumps(TEXT_SCHEMA).encode()
        return "json", "jsonschema", TEXT_SCHEMA["title"], schema, {}, _free(topic.channel, encode_text)  # type: ignore[return-value]
    if message is Document:
        schema = json.dumps(DOCUMENT_SCHEMA).encode()
        title = str(DOCUMENT_SCHEMA["title"])
        return "json", "jsonschema", title, schema, {}, _free(topic.channel, encode_document)
    if message is Event:
        return _protobuf(FoxgloveLog, _free(topic.channel, encode_event))
    if issubclass(message, Protobuf):
        return _protobuf(message, _free(topic.channel, attrgetter("body")))
    layout = layout_of(topic.message)  # type: ignore[arg-type]
    encoder = fixed_encoder(layout, topic.channel)
    return "protobuf", "protobuf", layout.name, descriptor_set(layout), channel_metadata(layout), encoder


def _protobuf(message: type[Protobuf], encoder: Encoder) -> tuple[str, str, str, bytes, dict[str, str], Encoder]:
    return "protobuf", "protobuf", message.DESCRIPTOR.full_name, file_descriptors(message), {}, encoder


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


def fixed_encoder(layout: Layout, channel: int) -> Encoder:
    """Return the encoder of a fixed layout: one `struct` call writes record header, tags and values."""
    packer = struct.Struct(_HEAD.format + layout.format[1:])
    pack, opcode = packer.pack, int(Opcode.MESSAGE)
    length = packer.size - 9
    fields = [(field.tag, bool(field.length)) for field in layout.fields]
    if any(packed for _, packed in fields):

        def encode_arrays(message: Any, log_time: int, sequence: int) -> bytes:
            values: list[Any] = [opcode, length, channel, sequence, log_time, log_time]
            for (tag, packed), value in zip(fields, message, strict=True):
                values.append(tag)
                values.extend(value if packed else (value,))
            return pack(*values)

        return encode_arrays

    # The tags stay in this list; only every second element changes from message to message.
    arguments: list[Any] = [opcode, length, channel, 0, 0, 0]
    for tag, _ in fields:
        arguments += (tag, 0)

    def encode_flat(message: Any, log_time: int, sequence: int) -> bytes:
        arguments[3] = sequence
        arguments[4] = arguments[5] = log_time
        arguments[7::2] = message
        return pack(*arguments)

    return encode_flat


def _free(channel: int, encode: Callable[[Any], bytes]) -> Encoder:
    def encode_record(message: Any, log_time: int, sequence: int) -> bytes:
        data = encode(message)
        return _HEAD.pack(Opcode.MESSAGE, _HEAD_BODY + len(data), channel, sequence, log_time, log_time) + data

    return encode_record


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
