"""Link addresses: UDP, TCP and serial.

The forms are ``udpin:HOST:PORT``, ``udpout:``, ``tcp:``, ``tcpin:`` and ``serial:DEV,BAUD``. Options follow a ``?``
and are joined by ``&``: ``rate=57600`` (the link is limited to a serial line of this baud rate), ``unsigned=accept``
(unsigned frames are accepted although a signing key is set) and ``forward=no`` (no frames are forwarded from or to
other links).

A lockstep partner on the same computer may also have ``unix:NAME``, an abstract Unix socket of Linux. A round trip
takes half as long as over TCP.
"""

from __future__ import annotations

from typing import NamedTuple

from wingbeat.errors import InputError

SOCKET_KINDS = ("udpin", "udpout", "tcp", "tcpin")
FORMS = "udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, tcpin:HOST:PORT or serial:DEVICE,BAUD"
LOCKSTEP_FORMS = FORMS.replace(" or ", ", ") + " or unix:NAME (Linux)"
"""forms for a lockstep partner"""
OPTIONS = "rate=BAUD, unsigned=accept, forward=no"
_FASTEST = 10_000_000
_UNSIGNED = {"accept": True, "refuse": False}
_FORWARD = {"yes": True, "no": False}


class LinkUrl(NamedTuple):
    """Parsed link address."""

    kind: str
    """udpin, udpout, tcp, tcpin, serial or unix"""
    host: str
    """host name or address, the serial device, or the name of a Unix socket"""
    port: int
    """port number, or the baud rate of a serial device"""
    rate: int = 0
    """baud; rate of the link, 0 for that of a serial device or for no limit"""
    unsigned: bool = False
    """True if unsigned frames are accepted although a signing key is set"""
    forward: bool = True
    """True if frames are forwarded from and to other links"""

    @property
    def baud(self) -> int:
        """Maximum rate of the link in baud, 0 for no limit."""
        return self.rate or (self.port if self.kind == "serial" else 0)

    def __str__(self) -> str:
        if self.kind == "serial":
            place = f"serial:{self.host},{self.port}"
        elif self.kind == "unix":
            place = f"unix:{self.host}"
        else:
            host = f"[{self.host}]" if ":" in self.host else self.host
            place = f"{self.kind}:{host}:{self.port}"
        chosen = [f"rate={self.rate}"] * bool(self.rate)
        chosen += ["unsigned=accept"] * self.unsigned + ["forward=no"] * (not self.forward)
        return f"{place}?{'&'.join(chosen)}" if chosen else place


def parse_url(text: str, lockstep: bool = False) -> LinkUrl:
    """Parse a link address; that of a ``lockstep`` partner may be a Unix socket.

    Raises:
        InputError: it has none of the forms, or an unknown option; the text lists them.
    """
    kind, _, rest = text.strip().partition(":")
    if lockstep and kind == "unix" and rest:
        return LinkUrl(kind, rest, 0)
    forms = LOCKSTEP_FORMS if lockstep else FORMS
    separator = "," if kind == "serial" else ":"
    place, found, tail = rest.rpartition(separator)
    number, asked, options = tail.partition("?")
    if (kind not in SOCKET_KINDS and kind != "serial") or not found or not place.strip("[]"):
        raise InputError(f"link {text!r} is not one of {forms}")
    highest = _FASTEST if kind == "serial" else 65535
    if not _within(number, highest):
        what = "baud rate" if kind == "serial" else "port"
        raise InputError(f"link {text!r}: the {what} must be a number from 1 to {highest}; forms: {forms}")
    url = LinkUrl(kind, place if kind == "serial" else place.strip("[]"), int(number))
    return _with_options(url, options, text) if asked else url


def _within(number: str, highest: int) -> bool:
    return number.isascii() and number.isdigit() and 0 < int(number) <= highest


def _with_options(url: LinkUrl, options: str, text: str) -> LinkUrl:
    for option in options.split("&"):
        name, _, value = option.partition("=")
        if name == "rate" and _within(value, _FASTEST):
            url = url._replace(rate=int(value))
        elif name == "unsigned" and value in _UNSIGNED:
            url = url._replace(unsigned=_UNSIGNED[value])
        elif name == "forward" and value in _FORWARD:
            url = url._replace(forward=_FORWARD[value])
        else:
            raise InputError(f"link {text!r}: {option!r} is none of {OPTIONS}")
    return url
