"""The links between vehicle and ground station: the address that each of them is given."""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import NamedTuple

from ports import free_port
from radio import radio

BAUD = 57600


class Addresses(NamedTuple):
    """How one link is called by each side."""

    vehicle: str
    """URL for ``wingbeat avionics --gcs``"""
    mavsdk: str
    """URL for `mavsdk.asyncio.Mavsdk.add_any_connection`"""
    mavproxy: tuple[str, ...]
    """options of mavproxy.py"""


@contextmanager
def udp() -> Iterator[Addresses]:
    """The vehicle speaks first, to where the ground station listens."""
    place = f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    yield Addresses(f"udpout:{place}", f"udpin://{place}", (f"--master=udpin:{place}",))


@contextmanager
def tcp() -> Iterator[Addresses]:
    """The vehicle is the server."""
    place = f"127.0.0.1:{free_port(socket.SOCK_STREAM)}"
    yield Addresses(f"tcpin:{place}", f"tcpout://{place}", (f"--master=tcp:{place}",))


@contextmanager
def serial() -> Iterator[Addresses]:
    """Two serial radios."""
    with radio() as ends:
        yield Addresses(
            f"serial:{ends.vehicle},{BAUD}",
            f"serial://{ends.ground}:{BAUD}",
            (f"--master={ends.ground}", f"--baudrate={BAUD}"),
        )


TRANSPORTS: dict[str, Callable[[], AbstractContextManager[Addresses]]] = {"udp": udp, "tcp": tcp, "serial": serial}
