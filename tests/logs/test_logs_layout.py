"""The bytes of the log are those of the protobuf library."""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded import FIXED_TOPICS, LIMITS

from avionics import messages as m
from logs.layout import Field, layout_of, varint
from logs.schema import channel_metadata, descriptor_set, layout_from_schema
from sim_bridge.messages import TruthLoads
from wingbeat.docstrings import split_unit
from wingbeat.message import Event
from wingbeat.topic import Topic


def library_class(topic: Topic) -> Any:
    """The message class that the protobuf library makes of the schema in the file."""
    layout = layout_of(topic.message)
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(descriptor_set(layout)).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(layout.name))


def values_of(field: Field) -> st.SearchStrategy[Any]:
    if field.length:
        single = values_of(field._replace(length=0))
        return st.lists(single, min_size=field.length, max_size=field.length).map(tuple)
    if field.scalar in LIMITS:
        return st.integers(*LIMITS[field.scalar])
    return st.floats(width=32 if field.scalar == "float" else 64)


def messages_of(topic: Topic) -> st.SearchStrategy[Any]:
    return st.tuples(*map(values_of, layout_of(topic.message).fields)).map(topic.message._make)


CLASSES = {topic.name: library_class(topic) for topic in FIXED_TOPICS}
same_bits = struct.Struct("<d").pack


@pytest.mark.parametrize("topic", FIXED_TOPICS, ids=lambda topic: topic.name)
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_bytes_are_those_of_the_protobuf_library(topic: Topic, data: st.DataObject) -> None:
    layout = layout_of(topic.message)
    message = data.draw(messages_of(topic))
    ours = layout.encode(message)
    theirs = CLASSES[topic.name](**message._asdict())
    assert ours == theirs.SerializeToString(deterministic=True)
    assert len(ours) == layout.size

    row = np.frombuffer(ours, layout.record_type())[0]
    for field, value in zip(layout.fields, message, strict=True):
        if isinstance(value, float):
            assert math.isnan(value) or same_bits(row[field.name]) == same_bits(value)
        else:
            assert np.array_equal(row[field.name], value)


@pytest.mark.parametrize("topic", FIXED_TOPICS, ids=lambda topic: topic.name)
def test_zeros_are_written_too(topic: Topic) -> None:
    layout = layout_of(topic.message)
    zeros = [(0,) * field.length if field.length else 0 for field in layout.fields]
    parsed = CLASSES[topic.name].FromString(layout.encode(tuple(zeros)))
    assert all(parsed.HasField(field.name) for field in layout.fields if not field.length)


@pytest.mark.parametrize("topic", FIXED_TOPICS, ids=lambda topic: topic.name)
def test_a_layout_survives_the_way_through_its_schema(topic: Topic) -> None:
    layout = layout_of(topic.message)
    assert layout_from_schema(layout.name, descriptor_set(layout), channel_metadata(layout)) == layout


def test_units_and_descriptions_come_from_the_docstrings() -> None:
    fields = {field.name: field for field in layout_of(m.ImuSample).fields}
    assert (fields["accel_x"].unit, fields["accel_x"].description) == (
        "m/s^2",
        "specific force along FRD x (forward)",
    )
    assert {field.unit for field in layout_of(TruthLoads).fields} == {"us", "N", "N m"}
    assert all(field.unit for topic in FIXED_TOPICS for field in layout_of(topic.message).fields)


def test_labels_of_enumerations() -> None:
    fields = {field.name: field for field in layout_of(m.NavigationStatus).fields}
    assert fields["mode"].labels == {int(mode): mode.name for mode in m.Mode}
    assert fields["mode"].scalar == "fixed32"


def test_units_stand_in_the_schema_as_comments() -> None:
    layout = layout_of(m.PowerState)
    info = FileDescriptorSet.FromString(descriptor_set(layout)).file[0].source_code_info
    comments = {tuple(location.path): location.leading_comments for location in info.location}
    assert comments[(4, 0, 2, 2)] == " A; mean over the burst\n"


def test_an_array_of_another_length_is_refused() -> None:
    with pytest.raises(struct.error):
        layout_of(m.AdcBurst).encode(m.AdcBurst(0, (1,) * 59, (1,) * 60))


def test_a_field_without_a_fixed_width_is_refused() -> None:
    with pytest.raises(TypeError, match=r"Event\.time_us"):
        layout_of(Event)


class Undeclared(NamedTuple):
    """No docstrings on the fields."""

    value: float


def test_a_field_without_a_docstring_has_no_unit() -> None:
    assert layout_of(Undeclared).fields == (Field("value", 1, "double"),)


@pytest.mark.parametrize(
    ("text", "expected"), [("N m", ("N m", "")), ("rad/s; about FRD x", ("rad/s", "about FRD x")), ("-", ("-", ""))]
)
def test_unit_before_the_semicolon(text: str, expected: tuple[str, str]) -> None:
    assert split_unit(text) == expected


@pytest.mark.parametrize(
    ("value", "expected"), [(0, b"\x00"), (127, b"\x7f"), (128, b"\x80\x01"), (300, b"\xac\x02")]
)
def test_varint(value: int, expected: bytes) -> None:
    """300 is the example in protobuf's own description of the encoding."""
    assert varint(value) == expected
