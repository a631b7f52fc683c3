"""Routing of frames between links.

Each link has a table of the received senders. A frame for one of them is forwarded to its link, a frame for all to
every link. It is neither returned to its source nor sent to a link on which its sender was received. A frame
forwarded a moment ago is not forwarded again, so that external loops between links have no effect. Frames of the
vehicle are not routed.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.framing import TARGETS, Frame
from avionics.link.transport import Peer

FORGET = 60.0
"""s; timeout of a sender on a link"""
MOST_KNOWN = 64
"""senders; limit of a table, to limit the memory for forged senders"""
REPEAT = 1.0
"""s; interval in which an identical frame is not forwarded again"""
MOST_REMEMBERED = 256
STAYS = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_SETUP_SIGNING})
"""messages that are not forwarded: the status of a single link, and keys"""

Address = tuple[int, int]
"""system and component"""


class Route(NamedTuple):
    """Link and time at which a sender was received."""

    peer: Peer
    received_at: float
    """s; wall-clock time"""


class Hop(NamedTuple):
    """Destination of a frame: one address on a link, or all on it."""

    link: int
    peer: Peer | None


def target_of(frame: Frame) -> Address:
    """Return system and component that a frame is for, 0 for all."""
    system, component = TARGETS.get(frame.message_id, (-1, -1))
    return _byte(frame.payload, system), _byte(frame.payload, component)


def _byte(payload: bytes, offset: int) -> int:
    # MAVLink 2 truncates trailing zeros of a payload.
    return payload[offset] if 0 <= offset < len(payload) else 0


class Router:
    """Routing tables of all links."""

    def __init__(self, open_links: list[bool], local: Address) -> None:
        """Create the router.

        ``open_links`` marks the participating links; ``local`` is the address of the vehicle.
        """
        self._open = open_links
        self._local = local
        self._known: list[dict[Address, Route]] = [{} for _ in open_links]
        self._passed: deque[tuple[float, bytes]] = deque(maxlen=MOST_REMEMBERED)

    def known(self, link: int) -> dict[Address, Route]:
        """Return the senders received on a link."""
        return dict(self._known[link])

    def hops(self, frame: Frame, link: int, peer: Peer, now: float) -> list[Hop]:
        """Store the sender and return the destinations of a frame.

        ``now`` (s) is the wall-clock time.
        """
        sender = (frame.system, frame.component)
        self._learn(sender, link, Route(peer, now))
        if len(self._open) < 2 or not self._open[link] or frame.message_id in STAYS:
            return []
        target = target_of(frame)
        hops = [hop for other in self._others(sender, link, now) for hop in self._to(target, other, now)]
        return hops if hops and self._first_time(frame.raw, now) else []

    def _learn(self, sender: Address, link: int, route: Route) -> None:
        table = self._known[link]
        if sender not in table and len(table) >= MOST_KNOWN:
            del table[min(table, key=lambda known: table[known].received_at)]
        table[sender] = route

    def _others(self, sender: Address, link: int, now: float) -> list[int]:
        """Return the open links on which the sender is unknown."""
        return [
            other
            for other, opened in enumerate(self._open)
            if opened and other != link and not self._fresh(self._known[other].get(sender), now)
        ]

    def _fresh(self, route: Route | None, now: float) -> bool:
        return route is not None and now - route.received_at <= FORGET

    def _to(self, target: Address, link: int, now: float) -> list[Hop]:
        system, component = target
        if system == 0:
            return [Hop(link, None)]
        if target == self._local:
            return []
        peers = {
            route.peer
            for address, route in self._known[link].items()
            if address[0] == system and component in (0, address[1]) and self._fresh(route, now)
        }
        return [Hop(link, peer) for peer in peers]

    def _first_time(self, raw: bytes, now: float) -> bool:
        while self._passed and now - self._passed[0][0] > REPEAT:
            self._passed.popleft()
        if any(raw == passed for _, passed in self._passed):
            return False
        self._passed.append((now, raw))
        return True
