"""Bytes in and out: UDP, TCP and serial, with own sockets.

Ground links are `Transport`: they never block, never raise because of what a peer does, and may have several
peers. A lockstep partner is a `Stream`: one peer, every wait bounded.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections import deque
from collections.abc import Hashable
from typing import Any, NamedTuple, Protocol

from avionics.link.serial_line import SerialLine
from avionics.link.urls import LinkUrl, parse_url
from wingbeat.errors import InputError

Peer = Hashable
MOST_PEERS = 16
"""A link serves no more than this many; the one that was silent longest makes room."""
HALF_OPEN = 5.0
"""s; of silence, five heartbeats, after which a TCP connection makes room for a new one where there is none left"""
GONE = 60.0
"""s; of silence after which a UDP station is sent nothing more: it may have come back on another port"""
_CHUNK = 65536
_MOST_DATAGRAMS = 100
_BACKLOG = 1 << 18


class Packet(NamedTuple):
    """Bytes from one peer; empty when the peer has gone."""

    data: bytes
    peer: Peer
    continues: bool = False
    """the rest of a long datagram comes in the next packet"""


class Transport(Protocol):
    """A ground link's bytes."""

    url: LinkUrl
    datagrams: bool
    """frames do not continue from one packet to the next, but where the packet says so"""
    portion: int
    """bytes that one `receive` begins to take at most; the rest waits where it is"""

    @property
    def dropped(self) -> int:
        """Frames that could not be sent."""

    @property
    def peers(self) -> tuple[Peer, ...] | None:
        """Who hears what is sent to all; None where there is one at most."""

    def receive(self, now: float) -> list[Packet]:
        """All that has arrived; ``now`` is wall-clock time in s."""

    def register_peer(self, peer: Peer) -> None:
        """A valid frame came from ``peer``: it may be sent to from now on."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to one peer, or to all."""

    def close(self) -> None:
        """Release the port."""


def open_transport(url: str | LinkUrl) -> Transport:
    """Open a ground link.

    Raises:
        InputError: not a link address, the port is in use, the device is missing, the host has no address.
    """
    parsed = url if isinstance(url, LinkUrl) else parse_url(url)
    if parsed.kind == "udpin":
        return UdpServer(parsed)
    if parsed.kind == "udpout":
        return UdpClient(parsed)
    if parsed.kind == "tcpin":
        return TcpServer(parsed)
    if parsed.kind == "tcp":
        return TcpClient(parsed)
    return SerialTransport(parsed)


def _resolve(url: LinkUrl, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Any]:
    try:
        family, _, _, _, address = socket.getaddrinfo(url.host, url.port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"{url}: no address for host {url.host!r} ({error})") from None
    return family, address


def _bound(url: LinkUrl, kind: socket.SocketKind) -> socket.socket:
    family, address = _resolve(url, kind)
    port = socket.socket(family, kind)
    try:
        if kind == socket.SOCK_STREAM and os.name == "posix":
            port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        port.bind(address)
        if kind == socket.SOCK_STREAM:
            port.listen(MOST_PEERS)
    except OSError as error:
        port.close()
        reason = error.strerror or str(error)
        raise InputError(f"{url}: cannot listen on port {url.port} of {url.host}: {reason}") from None
    return port


class UdpServer:
    """``udpin``: waits for ground stations and answers each that sent a valid frame."""

    datagrams = True

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.dropped = 0
        self.portion = _CHUNK
        self._received_at: dict[Any, float] = {}
        self._now = 0.0
        self._socket = _bound(url, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._mailbox = _Mailbox(self._socket)

    def receive(self, now: float) -> list[Packet]:
        """All datagrams that have arrived."""
        self._now = now
        self._drop_stale_peers()
        return self._mailbox.receive(self.portion)

    def _drop_stale_peers(self) -> None:
        """Who was heard last stays: it may be that only his own words are lost."""
        if len(self._received_at) > 1:
            last = max(self._received_at.values())
            self._received_at = {
                peer: heard for peer, heard in self._received_at.items() if heard == last or self._now - heard <= GONE
            }

    def register_peer(self, peer: Peer) -> None:
        """Remember where a valid frame came from."""
        if peer not in self._received_at and len(self._received_at) >= MOST_PEERS:
            del self._received_at[min(self._received_at, key=lambda known: self._received_at[known])]
        self._received_at[peer] = self._now

    @property
    def peers(self) -> tuple[Peer, ...]:
        """Who was heard."""
        return tuple(self._received_at)

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to one ground station, or to all that were heard."""
        for address in tuple(self._received_at) if peer is None else (peer,):
            self.dropped += not _sent(self._socket, data, address)

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


class UdpClient:
    """``udpout``: speaks to one ground station that listens, whether or not it is there yet."""

    datagrams = True
    peers = None

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.dropped = 0
        self.portion = _CHUNK
        family, self._address = _resolve(url, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._mailbox = _Mailbox(self._socket)

    def receive(self, now: float) -> list[Packet]:
        """All datagrams that have arrived."""
        return self._mailbox.receive(self.portion)

    def register_peer(self, peer: Peer) -> None:
        """Nothing to remember: there is one ground station."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to the ground station."""
        self.dropped += not _sent(self._socket, data, self._address if peer is None else peer)

    def close(self) -> None:
        """Release the socket."""
        self._socket.close()


class _Mailbox:
    """The datagrams of a socket; one that is longer than a portion is taken whole, and given in portions."""

    def __init__(self, port: socket.socket) -> None:
        self._port = port
        self._rest = Packet(b"", None)

    def receive(self, portion: int) -> list[Packet]:
        packets: list[Packet] = []
        taken = 0
        for _ in range(_MOST_DATAGRAMS):
            if taken >= portion or not self._fetched():
                break
            data, peer, _ = self._rest
            self._rest = Packet(data[portion:], peer)
            if data:
                packets.append(Packet(data[:portion], peer, continues=len(data) > portion))
                taken += len(packets[-1].data)
        return packets

    def _fetched(self) -> bool:
        """Whether there is something to give; fetches the next datagram where nothing is left of the last."""
        if self._rest.data:
            return True
        try:
            self._rest = Packet(*self._port.recvfrom(_CHUNK))
        except ConnectionError:
            return True  # an earlier datagram found nobody there: not the next one's fault
        except OSError:
            return False
        return True


def _sent(port: socket.socket, data: bytes, address: Any) -> bool:
    try:
        port.sendto(data, address)
    except OSError:
        return False
    return True


class _Connection:
    """One non-blocking TCP connection with a bounded queue of bytes still to be sent."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = connected
        self.disconnected = False
        self._queue = bytearray()

    def receive(self, portion: int) -> bytes:
        """At most so much of what has arrived; sets ``disconnected`` when the peer closed."""
        try:
            data = self.socket.recv(portion)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        self.disconnected = not data
        return data

    def send(self, data: bytes) -> bool:
        """Send or queue one frame; False when the queue is full, so that a frame is sent whole or not at all."""
        if len(self._queue) + len(data) > _BACKLOG:
            self.flush()
            if len(self._queue) + len(data) > _BACKLOG:
                return False
        self._queue += data
        self.flush()
        return True

    def flush(self) -> None:
        """Send what the peer's window takes now."""
        try:
            while self._queue:
                del self._queue[: self.socket.send(self._queue)]
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self.disconnected = True
            self._queue.clear()


class TcpServer:
    """``tcpin``: any number of ground stations connect to one port."""

    datagrams = False

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.dropped = 0
        self.portion = _CHUNK
        self._socket = _bound(url, socket.SOCK_STREAM)
        self._socket.setblocking(False)
        self._connections: dict[Any, _Connection] = {}
        self._reached = 0
        self._received_at: dict[Any, float] = {}
        self._now = 0.0

    def receive(self, now: float) -> list[Packet]:
        """What has arrived, after letting in who waits at the door; who was not reached is first the next time."""
        self._now = now
        packets, left = self._let_in(), self.portion
        for connection in self._connections.values():
            connection.flush()
        waiting = deque(self._connections.items())
        waiting.rotate(-self._reached)
        for peer, connection in waiting:
            if left <= 0:
                break
            self._reached += 1
            data = connection.receive(left)
            left -= len(data)
            if connection.disconnected:
                self._hang_up(peer)
            if data or connection.disconnected:
                packets.append(Packet(data, peer))
        self._reached %= max(len(waiting), 1)
        return packets

    def _let_in(self) -> list[Packet]:
        """Who waits, as far as there is room; says who had to go for it."""
        disconnected: list[Packet] = []
        with contextlib.suppress(OSError):
            for _ in range(MOST_PEERS):
                full = len(self._connections) >= MOST_PEERS
                spare = self._spare() if full else None
                if full and spare is None:
                    break
                connected, address = self._socket.accept()
                if spare is not None:
                    self._hang_up(spare)
                    disconnected.append(Packet(b"", spare))
                self._connections[address] = _Connection(connected)
        return disconnected

    def _spare(self) -> Any:
        """Who makes room: the oldest that never said a valid word, else who has been silent for long; or None."""
        strangers = [peer for peer in self._connections if peer not in self._received_at]
        if strangers:
            return strangers[0]
        quietest = min(self._received_at, key=lambda peer: self._received_at[peer])
        return quietest if self._now - self._received_at[quietest] > HALF_OPEN else None

    def _hang_up(self, peer: Any) -> None:
        self._connections.pop(peer).socket.close()
        self._received_at.pop(peer, None)

    def register_peer(self, peer: Peer) -> None:
        """Remember who said a valid word, and when: who only holds the door open makes room for others."""
        if peer in self._connections:
            self._received_at[peer] = self._now

    @property
    def peers(self) -> tuple[Peer, ...]:
        """Who is connected."""
        return tuple(self._connections)

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to one ground station, or to all that are connected."""
        for address, connection in self._connections.items():
            if peer is None or peer == address:
                self.dropped += not connection.send(data)

    def close(self) -> None:
        """Hang up and release the port."""
        for connection in self._connections.values():
            connection.socket.close()
        self._connections.clear()
        self._received_at.clear()
        self._socket.close()


class TcpClient:
    """``tcp``: connects to a ground station, and again after a second whenever it is gone."""

    datagrams = False
    peers = None
    retry = 1.0
    """s; between two attempts"""

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.dropped = 0
        self.portion = _CHUNK
        self._family, self._address = _resolve(url, socket.SOCK_STREAM)
        self.trouble = ""
        """-; why the last attempt to connect failed, empty where none did"""
        self._connecting: socket.socket | None = None
        self._connection: _Connection | None = None
        self._next_attempt = -float("inf")

    def receive(self, now: float) -> list[Packet]:
        """What has arrived; keeps the connection up."""
        if self._connection is None:
            self._connect(now)
            return []
        self._connection.flush()
        data = self._connection.receive(self.portion)
        if self._connection.disconnected:
            self._connection.socket.close()
            self._connection = None
            return [Packet(b"", self._address)]
        return [Packet(data, self._address)] if data else []

    def _connect(self, now: float) -> None:
        if self._connecting is None and now >= self._next_attempt:
            self._next_attempt = now + self.retry
            self._connecting = socket.socket(self._family, socket.SOCK_STREAM)
            self._connecting.setblocking(False)
            self._connecting.connect_ex(self._address)
        elif self._connecting is not None and (_writable(self._connecting) or now >= self._next_attempt):
            attempt, self._connecting = self._connecting, None
            error = attempt.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            self.trouble = os.strerror(error) if error else ""
            if not error and _connected(attempt):
                self._connection = _Connection(attempt)
            else:
                attempt.close()

    def register_peer(self, peer: Peer) -> None:
        """Nothing to remember: there is one ground station."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send when connected; a ground station that is not there misses it."""
        if self._connection is None or not self._connection.send(data):
            self.dropped += 1

    def close(self) -> None:
        """Hang up."""
        if self._connecting is not None:
            self._connecting.close()
        if self._connection is not None:
            self._connection.socket.close()
        self._connecting = self._connection = None
        self._next_attempt = float("inf")


def _writable(attempt: socket.socket) -> bool:
    _, ready, failed = select.select([], [attempt], [attempt], 0.0)
    return bool(ready or failed)


def _connected(attempt: socket.socket) -> bool:
    try:
        attempt.getpeername()
    except OSError:
        return False
    return True


class SerialTransport:
    """``serial``: a telemetry radio or a cable; one that was pulled out is silent until it is back."""

    datagrams = False
    peers = None

    def __init__(self, url: LinkUrl) -> None:
        """Open the device.

        Raises:
            InputError: it is missing, in use, or does not take this baud rate.
        """
        self.url = url
        self.portion = _CHUNK
        self._line = SerialLine(url.host, url.port)

    @property
    def dropped(self) -> int:
        """Frames that the device did not take whole."""
        return self._line.dropped

    def receive(self, now: float) -> list[Packet]:
        """What has arrived."""
        data = self._line.read(0.0, self.portion)
        return [Packet(data, self.url.host)] if data else []

    def register_peer(self, peer: Peer) -> None:
        """Nothing to remember: there is one wire."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send without waiting; a frame that the device does not take whole is counted as dropped."""
        self._line.write(data)

    def close(self) -> None:
        """Release the device."""
        self._line.close()


# --- one lockstep partner ----------------------------------------------------------------------------------


class Stream(Protocol):
    """The bytes of one lockstep partner."""

    name: str

    def read(self, timeout: float) -> bytes | None:
        """Bytes as soon as there are some; empty after ``timeout`` s without any, None when the peer has gone."""

    def write(self, data: bytes) -> bool:
        """Send; False when the peer has gone or takes nothing for `WRITE_PATIENCE`."""

    def close(self) -> None:
        """Hang up."""


WRITE_PATIENCE = 5.0
"""s; how long a lockstep partner may leave its receive buffer full."""
AT_ONCE, LOOKS = 2e-3, 64
"""s, -; a partner in a hurry has answered by then; looks between two at the clock"""
CREDIT, RENEWED = 64, 2000
"""-; late answers until an end in a hurry sleeps again; answers in time, with no late one between, that undo them"""


class SocketStream:
    """A TCP connection with Nagle's delay off."""

    def __init__(self, connected: socket.socket, name: str) -> None:
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # Without a timeout of the socket's own: Python would ask the system twice for every read and write.
        connected.setblocking(False)
        self.name = name
        self._socket = connected
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(connected, select.POLLIN)
        self._writable.register(connected, select.POLLOUT)
        self._credit = self._in_time = 0

    def enable_busy_poll(self) -> None:
        """Wait without sleeping from now on: for a partner who answers at once, on a core of its own.

        Where answers are late time and again, the cores are wanted by others, and this end sleeps as before.
        """
        self._credit = CREDIT

    def read(self, timeout: float) -> bytes | None:
        """Bytes as soon as there are some; a wait of less than a millisecond is one of a millisecond."""
        try:
            if (self._credit and self._watch()) or self._readable.poll(max(1e3 * timeout, 1.0)):
                return self._socket.recv(_CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None
        return b""

    def _watch(self) -> bool:
        """Look for bytes until there are some, without sleeping; False where the partner takes too long."""
        poll, end = self._readable.poll, 0.0
        while True:
            for _ in range(LOOKS):
                if poll(0):
                    self._in_time += 1
                    if self._in_time == RENEWED:
                        self._credit, self._in_time = CREDIT, 0
                    return True
            now = time.perf_counter()
            end = end or now + AT_ONCE
            if now >= end:
                self._credit, self._in_time = self._credit - 1, 0
                return False

    def write(self, data: bytes) -> bool:
        """Send all of it."""
        try:
            sent = self._socket.send(data)
        except BlockingIOError:
            sent = 0
        except OSError:
            return False
        return sent == len(data) or self._write_rest(data[sent:])

    def _write_rest(self, data: bytes) -> bool:
        end = time.monotonic() + WRITE_PATIENCE
        while data:
            try:
                if not self._writable.poll(max(1e3 * (end - time.monotonic()), 0.0)):
                    return False
                data = data[self._socket.send(data) :]
            except BlockingIOError:
                continue
            except OSError:
                return False
        return True

    def close(self) -> None:
        """Hang up."""
        self._socket.close()


class Listener:
    """Waits at a TCP port for one lockstep partner."""

    def __init__(self, url: str | LinkUrl) -> None:
        """Bind ``tcp:HOST:PORT`` or ``tcpin:HOST:PORT``.

        Raises:
            InputError: another kind of address, or the port is in use.
        """
        self.url = url if isinstance(url, LinkUrl) else parse_url(url)
        if self.url.kind not in ("tcp", "tcpin"):
            raise InputError(f"{self.url}: a world listens on tcp:HOST:PORT")
        self._socket = _bound(self.url, socket.SOCK_STREAM)

    @property
    def port(self) -> int:
        """The port that is listened on."""
        return int(self._socket.getsockname()[1])

    def accept(self, timeout: float) -> SocketStream | None:
        """The partner's connection, or None when nobody came for ``timeout`` s."""
        self._socket.settimeout(timeout)
        try:
            connected, address = self._socket.accept()
        except TimeoutError:
            return None
        return SocketStream(connected, f"{address[0]}:{address[1]}")

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


def open_stream(url: str | LinkUrl, timeout: float) -> Stream | None:
    """Reach a lockstep partner; None when it did not answer for ``timeout`` s.

    ``tcp`` connects and tries again while the partner starts, ``tcpin`` waits for it, ``serial`` opens the device.

    Raises:
        InputError: not an address of these kinds, the host has no address, the device is missing.
    """
    parsed = url if isinstance(url, LinkUrl) else parse_url(url)
    if parsed.kind == "serial":
        return SerialLine(parsed.host, parsed.port)
    if parsed.kind == "tcpin":
        listener = Listener(parsed)
        try:
            return listener.accept(timeout)
        finally:
            listener.close()
    if parsed.kind != "tcp":
        raise InputError(f"{parsed}: a lockstep partner is on tcp:, tcpin: or serial:")
    return _connect_stream(parsed, timeout)


def _connect_stream(url: LinkUrl, timeout: float) -> SocketStream | None:
    family, address = _resolve(url, socket.SOCK_STREAM)
    deadline = time.monotonic() + timeout
    while True:
        attempt = socket.socket(family, socket.SOCK_STREAM)
        attempt.settimeout(max(0.05, deadline - time.monotonic()))
        try:
            attempt.connect(address)
        except OSError:
            attempt.close()
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.02)
        else:
            return SocketStream(attempt, str(url))
