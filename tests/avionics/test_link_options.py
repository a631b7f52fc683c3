"""Addresses of links with their options, as a person writes them."""

from __future__ import annotations

import pytest
from link_wires import Wire

from avionics.link.urls import OPTIONS, LinkUrl, parse_url
from wingbeat.errors import InputError


@pytest.mark.parametrize(
    ("text", "url"),
    [
        ("udpout:h:1?rate=57600", LinkUrl("udpout", "h", 1, rate=57600)),
        ("serial:/dev/ttyACM0,115200?unsigned=accept", LinkUrl("serial", "/dev/ttyACM0", 115200, unsigned=True)),
        ("tcpin:h:1?rate=9600&unsigned=accept&forward=no", LinkUrl("tcpin", "h", 1, 9600, True, False)),
    ],
)
def test_the_options_of_an_address_are_read_and_written_again(text: str, url: LinkUrl) -> None:
    assert parse_url(text) == url and str(url) == text


@pytest.mark.parametrize(
    "tail", ["?", "?rate=0", "?rate=x", "?unsigned=maybe", "?forward", "?speed=3", "?rate=1&", "?&"]
)
def test_an_unknown_option_is_refused_with_those_that_there_are(tail: str) -> None:
    with pytest.raises(InputError) as refused:
        parse_url(f"udpin:h:1{tail}")
    assert OPTIONS in str(refused.value) and "\n" not in str(refused.value)


def test_a_serial_line_is_as_fast_as_its_baud_rate_unless_it_is_said_otherwise() -> None:
    assert parse_url("serial:/dev/x,57600").baud == 57600
    assert parse_url("serial:/dev/x,57600?rate=9600").baud == 9600
    assert parse_url("udpin:h:1").baud == 0 and Wire("udpin:h:1?rate=300").url.baud == 300
