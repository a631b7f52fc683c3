"""The addresses of links: ``udpin:HOST:PORT``, ``udpout:``, ``tcp:``, ``tcpin:`` and ``serial:DEV,BAUD``."""

from __future__ import annotations

from typing import NamedTuple

from avionics.quantities import BadInput

SOCKET_KINDS = ("udpin", "udpout", "tcp", "tcpin")
FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:DEVICE,BAUD"


class LinkUrl(NamedTuple):
    """An address of a link, taken apart."""

    kind: str
    """udpin, udpout, tcp, tcpin or serial"""
    host: str
    """host name or address, or the serial device"""
    port: int
    """port number, or the baud rate of a serial device"""

    def __str__(self) -> str:
        if self.kind == "serial":
            return f"serial:{self.host},{self.port}"
        return (
            f"{self.kind}:[{self.host}]:{self.port}" if ":" in self.host else f"{self.kind}:{self.host}:{self.port}"
        )


def parse_url(text: str) -> LinkUrl:
    """Take a link's address apart.

    Raises:
        BadInput: it has none of the five forms; the text names them.
    """
    kind, _, rest = text.strip().partition(":")
    separator = "," if kind == "serial" else ":"
    place, found, number = rest.rpartition(separator)
    if (kind not in SOCKET_KINDS and kind != "serial") or not found or not place.strip("[]"):
        raise BadInput(f"link {text!r} is not one of {FORMS}")
    highest = 10_000_000 if kind == "serial" else 65535
    if not (number.isascii() and number.isdigit()) or not 0 < int(number) <= highest:
        what = "baud rate" if kind == "serial" else "port"
        raise BadInput(f"link {text!r}: the {what} must be a number from 1 to {highest}; forms: {FORMS}")
    return LinkUrl(kind, place if kind == "serial" else place.strip("[]"), int(number))
