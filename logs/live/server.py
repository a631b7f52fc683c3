"""Foxglove server of a growing recording (``foxglove-sdk``).

A thread follows the files that the flight's processes write, and has no other tie to them: a viewer that is slow,
absent or gone delays no tick and changes no byte of a recording. Schemas and messages go out as they stand there.
"""

from __future__ import annotations

import logging
import threading
import time
import traceback
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from mcap.records import Channel, Schema

from avionics.topics import TOPICS as FLOWN
from logs.codecs import codec_for
from logs.extras import load_extra
from logs.live.follower import Follower
from logs.live.playout import Playout
from logs.scene import ESTIMATED_SCENE, ESTIMATED_TRANSFORMS, LOCATION, SCENE, TRANSFORMS
from sim_bridge.topics import TOPICS as TRUE
from wingbeat.errors import InputError
from wingbeat.topic import Topic

HOST, PORT = "127.0.0.1", 8765
"""default address of servers in Foxglove"""
KNOWN = tuple(topic for topic in (*FLOWN, *TRUE, TRANSFORMS, SCENE, LOCATION) if topic.logged)
"""topics of a simulated flight"""
ALONE = tuple(topic for topic in (*FLOWN, ESTIMATED_TRANSFORMS, ESTIMATED_SCENE, LOCATION) if topic.logged)
"""topics of a flight computer without a simulator"""
PERIOD = 0.02
"""s; wall-clock interval of file checks"""
BACKLOG = 16_384
"""messages; limit of the queue of one viewer: seconds of a whole flight; the oldest are dropped"""
FAREWELL = 0.3
"""s; timeout for viewers to receive the last messages, and then to close"""
PATIENCE = 5.0
"""s; timeout for the thread to end"""


class Address(NamedTuple):
    """Address of the server."""

    host: str = HOST
    port: int = PORT
    """0: any free port"""


def parse_address(text: str) -> Address:
    """Parse ``HOST:PORT``.

    Raises:
        InputError: it is not of that form.
    """
    host, _, number = text.rpartition(":")
    if not host.strip("[]") or not (number.isascii() and number.isdigit()) or int(number) > 65535:
        raise InputError(f"address {text!r} for viewers is not HOST:PORT, such as {HOST}:{PORT}")
    return Address(host.strip("[]"), int(number))


class LiveServer:
    """Server of growing recordings for viewers; as a context manager it sends the rest and closes at the end."""

    def __init__(self, address: Address, paths: Sequence[Path], topics: Iterable[Topic[Any]] | None = None) -> None:
        """Listen at once, and follow ``paths`` as soon as they exist.

        The ``topics`` (default: `KNOWN`) are advertised from the start, others when they appear: foxglove-sdk 0.30
        announces a new channel before it accepts subscriptions to it, and a subscription in between is lost.

        Raises:
            InputError: foxglove-sdk is not installed, or the address is not available.
        """
        self._sdk = load_extra("foxglove", "foxglove-sdk", "a live view")
        self._followers = [Follower(path) for path in paths]
        self._playout = Playout()
        self._context = self._sdk.Context()
        self._channels: dict[int, Any] = {}
        self._declared: dict[int, Channel] = {}
        # The package's messages about viewers do not belong between the lines of a flight.
        logging.getLogger("foxglove").addHandler(logging.NullHandler())
        for topic in KNOWN if topics is None else topics:
            codec = codec_for(topic)
            self._offer(codec.channel, codec.schema)
        self._ending = threading.Event()
        self._server = self._listen(address)
        self.url = f"ws://{f'[{address.host}]' if ':' in address.host else address.host}:{self._server.port}"
        """URL for viewers"""
        self.failure = ""
        """why a file is not shown, one line"""
        self.traceback = ""
        """of that failure"""
        self._thread = threading.Thread(target=self._serve, name="live", daemon=True)
        self._thread.start()

    @property
    def skipped(self) -> int:
        """Number of messages that were not shown because too many arrived at once."""
        return sum(follower.skipped for follower in self._followers)

    @property
    def finished(self) -> bool:
        """Whether the writers have closed all files."""
        return all(follower.finished for follower in self._followers)

    def close(self) -> None:
        """Send the rest and close the port, with a timeout for viewers that do not receive."""
        self._ending.set()
        self._thread.join(PATIENCE)
        stopping = threading.Thread(target=self._server.stop, name="live stop", daemon=True)
        stopping.start()
        stopping.join(FAREWELL)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _listen(self, address: Address) -> Any:
        try:
            return self._sdk.start_server(
                name="wingbeat",
                host=address.host,
                port=address.port,
                # Viewers then show the time of the flight, at any speed factor.
                capabilities=[self._sdk.websocket.Capability.Time],
                context=self._context,
                message_backlog_size=BACKLOG,
            )
        except RuntimeError as error:
            reason = str(error).removeprefix("FoxgloveError: ")
            raise InputError(f"no live view on {address.host}:{address.port}: {reason}") from None

    def _serve(self) -> None:
        before = time.monotonic()
        try:
            while not self._ending.wait(PERIOD):
                now = time.monotonic()
                self._show(now - before)
                before = now
            self._show(PERIOD, last=True)
        # A fault of this thread must not affect the recording or the flight.
        except BaseException as reason:  # foxglove-sdk's panics are no Exception
            self.failure = str(reason) or type(reason).__name__
            self.traceback = traceback.format_exc()
        finally:
            for follower in self._followers:
                follower.close()

    def _show(self, dt: float, last: bool = False) -> None:
        for follower in self._followers:
            messages = follower.read(self._has_subscriber)
            for channel in follower.channels.values():
                if self._declared.get(channel.id) != channel:
                    self._offer(channel, follower.schemas.get(channel.schema_id))
            self._playout.add(messages)
        newest = max(follower.end_ns for follower in self._followers)
        due = self._playout.rest() if last else self._playout.step(newest, dt)
        for log_ns, number, data in due:
            self._channels[number].log(data, log_time=log_ns)
        if self._playout.now_ns:
            self._server.broadcast_time(self._playout.now_ns)
        if last and due:
            time.sleep(FAREWELL)

    def _has_subscriber(self, channel: int) -> bool:
        shown = self._channels.get(channel)
        return shown is not None and bool(shown.has_sinks())

    def _offer(self, channel: Channel, schema: Schema | None) -> None:
        self._declared[channel.id] = channel
        self._channels[channel.id] = self._sdk.Channel(
            channel.topic,
            message_encoding=channel.message_encoding,
            schema=schema and self._sdk.Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
            metadata=channel.metadata,
            context=self._context,
        )
