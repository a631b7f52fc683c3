"""Which links a frame that came over one of them goes on to.

Each link has a table of who was heard there. A frame for one of them goes where it was heard, a frame for all goes to
every link; neither goes back to where it came from, nor to a link where its own sender was heard: there it is known
already. A frame that was passed on a moment ago is not passed on again, so that links which meet elsewhere make no
circle. Our own frames take no part in this.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from avionics.link.dialect import mavlink
from avionics.link.framing import TARGETS, Frame
from avionics.link.transport import Peer

FORGET = 60.0
"""s; after which who is silent is no longer known on a link"""
MOST_KNOWN = 64
"""senders on a link; forged ones fill no memory"""
REPEAT = 1.0
"""s; in which the same frame is not passed on again"""
MOST_REMEMBERED = 256
STAYS = frozenset({mavlink.MAVLINK_MSG_ID_RADIO_STATUS, mavlink.MAVLINK_MSG_ID_SETUP_SIGNING})
"""What speaks of one link alone, and keys, which nobody else is to hear."""

Address = tuple[int, int]
"""system and component"""


class Route(NamedTuple):
    """Where somebody was heard."""

    peer: Peer
    received_at: float
    """s; wall-clock time"""


class Hop(NamedTuple):
    """Where a frame goes: to one address on a link, or to all on it."""

    link: int
    peer: Peer | None


def target_of(frame: Frame) -> Address:
    """System and component that a frame is for, 0 for all."""
    system, component = TARGETS.get(frame.message_id, (-1, -1))
    return _byte(frame.payload, system), _byte(frame.payload, component)


def _byte(payload: bytes, offset: int) -> int:
    # MAVLink 2 cuts zeros off the end of a payload.
    return payload[offset] if 0 <= offset < len(payload) else 0


class Router:
    """The tables of all links."""

    def __init__(self, open_links: list[bool], local: Address) -> None:
        """``open_links`` says which links take part, ``local`` who we are."""
        self._open = open_links
        self._local = local
        self._known: list[dict[Address, Route]] = [{} for _ in open_links]
        self._passed: deque[tuple[float, bytes]] = deque(maxlen=MOST_REMEMBERED)

    def known(self, link: int) -> dict[Address, Route]:
        """Who was heard on a link."""
        return dict(self._known[link])

    def hops(self, frame: Frame, link: int, peer: Peer, now: float) -> list[Hop]:
        """Remember the sender, and say where the frame goes on to; ``now`` is wall-clock time in s."""
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
        """Open links where the sender is not known."""
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
