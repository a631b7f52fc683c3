"""Byte transports: UDP, TCP and serial.

Ground links are `Transport`: they never block, raise no exceptions for actions of a peer, and may have several peers.
A lockstep partner is a `Stream` with one peer and bounded waits.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Hashable
from typing import Any, NamedTuple, Protocol

from avionics.link.serial_line import SerialLine
from avionics.link.urls import LinkUrl, parse_url
from wingbeat.errors import InputError

Peer = Hashable
MOST_PEERS = 16
"""limit of peers on a link; the one with the oldest reception is replaced"""
HALF_OPEN = 5.0
"""s; idle time, five heartbeats, after which a TCP connection may be replaced by a new one"""
GONE = 60.0
"""s; idle time after which a UDP station is removed: it may have reconnected from another port"""
_CHUNK = 65536
_STREAM_CHUNK = 8192
"""bytes; read at once from a lockstep partner, more than its longest tick"""
_MOST_DATAGRAMS = 100
_BACKLOG = 1 << 18


class Packet(NamedTuple):
    """Bytes of one peer; empty if it has disconnected."""

    data: bytes
    peer: Peer
    continues: bool = False
    """True if the next packet continues a long datagram"""


class Transport(Protocol):
    """Byte transport of a ground link."""

    url: LinkUrl
    datagrams: bool
    """True if frames do not continue in the next packet unless the packet is marked so"""
    portion: int
    """bytes; maximum that one `receive` begins to read; the remainder stays queued"""

    @property
    def dropped(self) -> int:
        """Number of frames that could not be sent."""

    @property
    def peers(self) -> tuple[Peer, ...] | None:
        """Recipients of messages to all; None if there is at most one."""

    def receive(self, now: float) -> list[Packet]:
        """Return the received packets; ``now`` (s) is the wall-clock time."""

    def register_peer(self, peer: Peer) -> None:
        """Register the sender of a valid frame as a recipient."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to one peer, or to all."""

    def close(self) -> None:
        """Close the transport."""


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
    if url.kind == "unix":
        if sys.platform != "linux":
            raise InputError(f"{url}: Unix sockets with a name are available on Linux only; use tcp:HOST:PORT")
        return socket.AF_UNIX, f"\0{url.host}"
    try:
        family, _, _, _, address = socket.getaddrinfo(url.host, url.port, type=kind)[0]
    except (OSError, UnicodeError) as error:
        raise InputError(f"{url}: no address for host {url.host!r} ({error})") from None
    return family, address


def _bound(url: LinkUrl, kind: socket.SocketKind) -> socket.socket:
    family, address = _resolve(url, kind)
    port = socket.socket(family, kind)
    try:
        if kind == socket.SOCK_STREAM and os.name == "posix" and family != socket.AF_UNIX:
            port.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        port.bind(address)
        if kind == socket.SOCK_STREAM:
            port.listen(MOST_PEERS)
    except OSError as error:
        port.close()
        reason = error.strerror or str(error)
        if url.kind == "unix":
            raise InputError(f"{url}: cannot listen: {reason}") from None
        raise InputError(f"{url}: cannot listen on port {url.port} of {url.host}: {reason}") from None
    return port


class UdpServer:
    """``udpin``: UDP server that answers ground stations after a valid frame."""

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
        """Return the received datagrams."""
        self._now = now
        self._drop_stale_peers()
        return self._mailbox.receive(self.portion)

    def _drop_stale_peers(self) -> None:
        """Remove timed-out peers except the last received.

        The last one is kept, because only its frames may be lost.
        """
        if len(self._received_at) > 1:
            last = max(self._received_at.values())
            self._received_at = {
                peer: heard for peer, heard in self._received_at.items() if heard == last or self._now - heard <= GONE
            }

    def register_peer(self, peer: Peer) -> None:
        """Store the address of a valid frame."""
        if peer not in self._received_at and len(self._received_at) >= MOST_PEERS:
            del self._received_at[min(self._received_at, key=lambda known: self._received_at[known])]
        self._received_at[peer] = self._now

    @property
    def peers(self) -> tuple[Peer, ...]:
        """Registered ground stations."""
        return tuple(self._received_at)

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to one ground station, or to all registered ones."""
        for address in tuple(self._received_at) if peer is None else (peer,):
            self.dropped += not _sent(self._socket, data, address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class UdpClient:
    """``udpout``: UDP client of one ground station, which need not be running yet."""

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
        """Return the received datagrams."""
        return self._mailbox.receive(self.portion)

    def register_peer(self, peer: Peer) -> None:
        """Do nothing: there is one ground station."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to the ground station."""
        self.dropped += not _sent(self._socket, data, self._address if peer is None else peer)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class _Mailbox:
    """Datagrams of a socket; a long one is read at once and returned in portions."""

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
        """Return whether data is available; read the next datagram if the last is used up."""
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
    """Non-blocking TCP connection with a bounded send queue."""

    def __init__(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = connected
        self.disconnected = False
        self._queue = bytearray()

    def receive(self, portion: int) -> bytes:
        """Return received bytes; set ``disconnected`` if the peer closed.

        The limit is ``portion`` bytes.
        """
        try:
            data = self.socket.recv(portion)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        self.disconnected = not data
        return data

    def send(self, data: bytes) -> bool:
        """Send or queue one frame; False if the queue is full.

        A frame is never sent in part.
        """
        if len(self._queue) + len(data) > _BACKLOG:
            self.flush()
            if len(self._queue) + len(data) > _BACKLOG:
                return False
        self._queue += data
        self.flush()
        return True

    def flush(self) -> None:
        """Send the queued bytes that fit the window of the peer."""
        try:
            while self._queue:
                del self._queue[: self.socket.send(self._queue)]
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self.disconnected = True
            self._queue.clear()


class TcpServer:
    """``tcpin``: TCP server for any number of ground stations."""

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
        """Accept new connections and return the received bytes.

        Connections not reached in one call are first in the next.
        """
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
        """Accept waiting connections within the limit; return the replaced ones."""
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
        """Return the connection to replace, or None.

        It is the oldest without a valid frame, else one that has timed out.
        """
        strangers = [peer for peer in self._connections if peer not in self._received_at]
        if strangers:
            return strangers[0]
        quietest = min(self._received_at, key=lambda peer: self._received_at[peer])
        return quietest if self._now - self._received_at[quietest] > HALF_OPEN else None

    def _hang_up(self, peer: Any) -> None:
        self._connections.pop(peer).socket.close()
        self._received_at.pop(peer, None)

    def register_peer(self, peer: Peer) -> None:
        """Store the time of a valid frame; connections without one may be replaced."""
        if peer in self._connections:
            self._received_at[peer] = self._now

    @property
    def peers(self) -> tuple[Peer, ...]:
        """Connected ground stations."""
        return tuple(self._connections)

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send to one ground station, or to all connected ones."""
        for address, connection in self._connections.items():
            if peer is None or peer == address:
                self.dropped += not connection.send(data)

    def close(self) -> None:
        """Close all connections and the port."""
        for connection in self._connections.values():
            connection.socket.close()
        self._connections.clear()
        self._received_at.clear()
        self._socket.close()


class TcpClient:
    """``tcp``: TCP client of a ground station that reconnects after a second."""

    datagrams = False
    peers = None
    retry = 1.0
    """s; interval of connection attempts"""

    def __init__(self, url: LinkUrl) -> None:
        self.url = url
        self.dropped = 0
        self.portion = _CHUNK
        self._family, self._address = _resolve(url, socket.SOCK_STREAM)
        self.trouble = ""
        """-; reason of the last failed attempt to connect, else empty"""
        self._connecting: socket.socket | None = None
        self._connection: _Connection | None = None
        self._next_attempt = -float("inf")

    def receive(self, now: float) -> list[Packet]:
        """Return the received bytes; reconnect if necessary."""
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
        """Do nothing: there is one ground station."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Send if connected; otherwise the data is lost."""
        if self._connection is None or not self._connection.send(data):
            self.dropped += 1

    def close(self) -> None:
        """Close the connection."""
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
    """``serial``: telemetry radio or cable that may be disconnected and reconnected."""

    datagrams = False
    peers = None

    def __init__(self, url: LinkUrl) -> None:
        """Open the device.

        Raises:
            InputError: it is missing, in use, or does not support this baud rate.
        """
        self.url = url
        self.portion = _CHUNK
        self._line = SerialLine(url.host, url.port)

    @property
    def dropped(self) -> int:
        """Number of frames that were written in part."""
        return self._line.dropped

    def receive(self, now: float) -> list[Packet]:
        """Return the received bytes."""
        data = self._line.read(0.0, self.portion)
        return [Packet(data, self.url.host)] if data else []

    def register_peer(self, peer: Peer) -> None:
        """Do nothing: there is one wire."""

    def send(self, data: bytes, peer: Peer | None = None) -> None:
        """Write without waiting; an incomplete frame counts as dropped."""
        self._line.write(data)

    def close(self) -> None:
        """Close the device."""
        self._line.close()


# --- one lockstep partner ----------------------------------------------------------------------------------


class Stream(Protocol):
    """Byte stream of one lockstep partner."""

    name: str

    def read(self, timeout: float) -> bytes | None:
        """Return bytes as soon as some are available.

        The result is empty after ``timeout`` (s), and None if the peer has disconnected.
        """

    def write(self, data: bytes) -> bool:
        """Send; False if the peer has disconnected or blocks for `WRITE_PATIENCE`."""

    def close(self) -> None:
        """Close the stream."""


WRITE_PATIENCE = 5.0
"""s; maximum time for which a lockstep partner may keep its receive buffer full"""
AT_ONCE, LOOKS = 2e-3, 64
"""s, -; duration of a busy poll, sufficient for a fast partner; polls between two reads of the clock"""
CREDIT, RENEWED = 64, 2000
"""-; late answers after which busy polling ends; consecutive answers in time that cancel them"""


class SocketStream:
    """Connection of a TCP socket without Nagle's algorithm, or of a Unix socket."""

    def __init__(self, connected: socket.socket, name: str) -> None:
        if connected.family != socket.AF_UNIX:
            connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # The timeout is the system's: with one of its own, Python makes two system calls for every read and write.
        connected.setblocking(True)
        self.name = name
        self._socket = connected
        self._timeout = -1.0
        self._readable, self._writable = select.poll(), select.poll()
        self._readable.register(connected, select.POLLIN)
        self._writable.register(connected, select.POLLOUT)
        self._credit = self._in_time = 0

    def enable_busy_poll(self) -> None:
        """Enable busy polling, for a partner with fast answers on its own core.

        After repeated late answers the cores are in demand, and the reads block again.
        """
        self._credit = CREDIT

    def read(self, timeout: float) -> bytes | None:
        """Return bytes as soon as some are available; waits are at least one millisecond."""
        try:
            if timeout != self._timeout:
                self._limit_waits(timeout)
            if self._credit:
                self._watch()
            return self._socket.recv(_STREAM_CHUNK) or None
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def _limit_waits(self, timeout: float) -> None:
        self._timeout = timeout
        seconds, fraction = divmod(max(timeout, 1e-3), 1.0)
        limit = struct.pack("@ll", int(seconds), int(fraction * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)

    def _watch(self) -> None:
        """Poll for bytes without blocking, up to the limit."""
        poll, end = self._readable.poll, 0.0
        while True:
            for _ in range(LOOKS):
                if poll(0):
                    self._in_time += 1
                    if self._in_time == RENEWED:
                        self._credit, self._in_time = CREDIT, 0
                    return
            now = time.perf_counter()
            end = end or now + AT_ONCE
            if now >= end:
                self._credit, self._in_time = self._credit - 1, 0
                return

    def write(self, data: bytes) -> bool:
        """Send all data."""
        try:
            sent = self._socket.send(data, socket.MSG_DONTWAIT)
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
                data = data[self._socket.send(data, socket.MSG_DONTWAIT) :]
            except BlockingIOError:
                continue
            except OSError:
                return False
        return True

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()


class Listener:
    """Server for one lockstep partner."""

    def __init__(self, url: str | LinkUrl) -> None:
        """Bind ``tcp:HOST:PORT``, ``tcpin:HOST:PORT`` or ``unix:NAME``.

        Raises:
            InputError: another kind of address, or the port is in use.
        """
        self.url = url if isinstance(url, LinkUrl) else parse_url(url, lockstep=True)
        if self.url.kind not in ("tcp", "tcpin", "unix"):
            raise InputError(f"{self.url}: a world listens on tcp:HOST:PORT or unix:NAME")
        self._socket = _bound(self.url, socket.SOCK_STREAM)

    @property
    def port(self) -> int:
        """Port of the server; 0 for a Unix socket."""
        return 0 if self.url.kind == "unix" else int(self._socket.getsockname()[1])

    def accept(self, timeout: float) -> SocketStream | None:
        """Return the connection of the partner, or None after ``timeout`` (s)."""
        self._socket.settimeout(timeout)
        try:
            connected, address = self._socket.accept()
        except TimeoutError:
            return None
        name = str(self.url) if self.url.kind == "unix" else f"{address[0]}:{address[1]}"
        return SocketStream(connected, name)

    def close(self) -> None:
        """Close the port."""
        self._socket.close()


def open_stream(url: str | LinkUrl, timeout: float) -> Stream | None:
    """Connect to a lockstep partner; None after ``timeout`` (s).

    ``tcp`` and ``unix`` connect and retry while the partner starts, ``tcpin`` waits for it, ``serial`` opens the
    device.

    Raises:
        InputError: not an address of these kinds, the host has no address, the device is missing.
    """
    parsed = url if isinstance(url, LinkUrl) else parse_url(url, lockstep=True)
    if parsed.kind == "serial":
        return SerialLine(parsed.host, parsed.port)
    if parsed.kind == "tcpin":
        listener = Listener(parsed)
        try:
            return listener.accept(timeout)
        finally:
            listener.close()
    if parsed.kind not in ("tcp", "unix"):
        raise InputError(f"{parsed}: a lockstep partner is on tcp:, tcpin:, unix: or serial:")
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
