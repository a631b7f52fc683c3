"""Layouts as protobuf descriptors, and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
    SourceCodeInfo,
)
from google.protobuf.message import DecodeError

from logs.layout import SCALARS, Field, Layout
from wingbeat.docstrings import split_unit

_TYPES = {name: FieldDescriptorProto.Type.Value(f"TYPE_{name.upper()}") for name in SCALARS}
_NAMES = {number: name for name, number in _TYPES.items()}
LARGEST_MESSAGE = 1 << 16
"""bytes; limit for reading with a fixed layout: a longer array may be damage, so larger messages are read one by one
"""
# Paths in a FileDescriptorProto of the source comments: message_type = 4, its field = 2.
_MESSAGE_PATH = (4, 0)
_FIELD_PATH = (4, 0, 2)


def descriptor_set(layout: Layout) -> bytes:
    """Return the serialized FileDescriptorSet of ``layout``; its comments contain units and descriptions."""
    package, _, name = layout.name.rpartition(".")
    file = FileDescriptorProto(name=f"{layout.name.replace('.', '/')}.proto", package=package, syntax="proto3")
    message = file.message_type.add(name=name)
    _comment(file.source_code_info, _MESSAGE_PATH, layout.description)
    for index, field in enumerate(layout.fields):
        _add_field(message, field)
        _comment(file.source_code_info, (*_FIELD_PATH, index), f"{field.unit}; {field.description}".rstrip("; "))
    return FileDescriptorSet(file=[file]).SerializeToString(deterministic=True)


def _add_field(message: DescriptorProto, field: Field) -> None:
    added = message.field.add(name=field.name, number=field.number, type=_TYPES[field.scalar])
    if field.length:
        added.label = FieldDescriptorProto.LABEL_REPEATED
        return
    # `optional` in proto3 is a oneof with one member, so a zero is written too.
    added.label = FieldDescriptorProto.LABEL_OPTIONAL
    added.proto3_optional = True
    added.oneof_index = len(message.oneof_decl)
    message.oneof_decl.add(name=f"_{field.name}")


def _comment(info: SourceCodeInfo, path: tuple[int, ...], text: str) -> None:
    line = len(info.location)
    info.location.add(path=path, span=(line, 0, 1), leading_comments=f" {text}\n")


def channel_metadata(layout: Layout) -> dict[str, str]:
    """Return the channel metadata that a protobuf schema cannot contain, as JSON: labels and array lengths."""
    labels = {f.name: {str(value): label for value, label in f.labels.items()} for f in layout.fields if f.labels}
    lengths = {field.name: field.length for field in layout.fields if field.length}
    return {key: json.dumps(value) for key, value in (("labels", labels), ("lengths", lengths)) if value}


def layout_from_schema(name: str, data: bytes, metadata: Mapping[str, str]) -> Layout | None:
    """Return the layout of a message as the log's own schema declares it; None if its length varies.

    ``data`` is a FileDescriptorSet, ``name`` the message in it, ``metadata`` that of the channel.
    """
    try:
        files = FileDescriptorSet.FromString(data).file
    except DecodeError:
        return None
    lengths, labels = _table(metadata, "lengths"), _table(metadata, "labels")
    for file in files:
        for index, message in enumerate(file.message_type):
            if f"{file.package}.{message.name}".lstrip(".") == name:
                return _layout(name, message, _comments(file, index), lengths, labels)
    return None


def _table(metadata: Mapping[str, str], key: str) -> dict[str, Any]:
    """Return a JSON object of the channel metadata; empty if absent or if another writer stored something else."""
    try:
        table = json.loads(metadata.get(key, "{}"))
    except (ValueError, RecursionError):
        return {}
    return table if isinstance(table, dict) else {}


def _comments(file: FileDescriptorProto, message: int) -> dict[tuple[int, ...], str]:
    """Comments of a message by their path inside it: () is the message, (2, i) its i-th field."""
    prefix = (4, message)
    return {
        tuple(location.path)[2:]: location.leading_comments
        for location in file.source_code_info.location
        if tuple(location.path)[:2] == prefix
    }


def _layout(
    name: str,
    message: DescriptorProto,
    comments: Mapping[tuple[int, ...], str],
    lengths: Mapping[str, Any],
    labels: Mapping[str, Any],
) -> Layout | None:
    fields = []
    for index, field in enumerate(message.field):
        length = _length(field, lengths)
        if length is None or field.number < 1 or not field.name.isidentifier():
            return None
        unit, text = split_unit(comments.get((2, index), "-"))
        names = _labels(labels.get(field.name))
        fields.append(Field(field.name, field.number, _NAMES[field.type], length, unit, text, names))
    size = sum(max(field.length, 1) * SCALARS[field.scalar].width for field in fields)
    if size > LARGEST_MESSAGE or len({field.name for field in fields}) < len(fields):
        return None
    return Layout(name, " ".join(comments.get((), "").split()), tuple(fields))


def _length(field: FieldDescriptorProto, lengths: Mapping[str, Any]) -> int | None:
    """Values of a packed array, 0 for a single value; None where that is not constant or cannot be."""
    if field.type not in _NAMES:
        return None
    if field.label != FieldDescriptorProto.LABEL_REPEATED:
        return 0 if field.proto3_optional else None
    document = lengths.get(field.name)
    return document if type(document) is int and document > 0 else None


def _labels(document: Any) -> dict[int, str]:
    """Names of values from a JSON object with a number in each key; none where it is something else."""
    if not isinstance(document, dict) or not all(isinstance(label, str) for label in document.values()):
        return {}
    try:
        return {int(value): label for value, label in document.items()}
    except ValueError:
        return {}
