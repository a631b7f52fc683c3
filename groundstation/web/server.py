"""HTTP and WebSocket server of the web view on the loopback interface.

One thread runs the server. Each browser has a task of its own, which sends the newest data at the browser's pace: a
slow browser gets fewer messages, and one that fails ends its own task only.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import secrets
import socket
import threading
import traceback
from queue import Empty, SimpleQueue
from types import TracebackType
from typing import Any, NamedTuple, Self

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.typing import Origin

from groundstation.web.feed import Cursor, Feed
from wingbeat.errors import InputError

HOST, PORT = "127.0.0.1", 8766
NAMES = (HOST, "localhost")
"""hosts under which a browser of this machine opens the page"""
SOCKET = "/link"
"""path of the WebSocket"""
PERIOD = 0.1
"""s; interval of the messages to a browser"""
LONGEST = 4096
"""bytes; limit of a message of a browser"""
TIMEOUT = 2.0
"""s; limit for the thread to end"""
SAFE = {
    "Content-Type": "text/html; charset=utf-8",
    "Cache-Control": "no-store",
    "Content-Security-Policy": "frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
"""headers of the page"""


class WebCommand(NamedTuple):
    """Command of a browser."""

    name: str
    """-; ``mode``, ``mission``, ``spectrum`` or a label of `orders.ORDERS`"""
    argument: str = ""
    """-; name of the mode"""


class WebServer:
    """Server of one page and of its WebSocket; as a context manager it closes its port at the end."""

    def __init__(self, page: str, feed: Feed, port: int = PORT) -> None:
        """Listen at once; ``port`` 0 is any free port.

        Only pages of this server may open the WebSocket (header Origin), and only a browser that knows `token` may
        command: the token is the fragment of `url`, which browsers send to nobody.

        Raises:
            InputError: the port is not available.
        """
        self.token = secrets.token_urlsafe(16)
        self._page, self._feed = page.encode(), feed
        self._commands: SimpleQueue[WebCommand] = SimpleQueue()
        try:
            self._socket = socket.create_server((HOST, port))
        except OSError as error:
            raise InputError(f"no web view on {HOST}:{port}: {error.strerror or error}; use --port") from None
        port = self._socket.getsockname()[1]
        self.url = f"http://{HOST}:{port}/#{self.token}"
        """URL of the page with the token"""
        self._origins = [Origin(f"http://{name}:{port}") for name in NAMES]
        self._hosts = frozenset(f"{name}:{port}" for name in NAMES)
        self.failure = ""
        """last failure of the server or of a browser, as a traceback"""
        self._loop = asyncio.new_event_loop()
        self._ended = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._thread.start()

    def commands(self) -> list[WebCommand]:
        """Return the commands received since the last call."""
        found = []
        with contextlib.suppress(Empty):
            while True:
                found.append(self._commands.get_nowait())
        return found

    def close(self) -> None:
        """Close the port and the connections."""
        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(self._ended.set)
        self._thread.join(TIMEOUT)
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        # A fault of this thread must not affect the link or the recording.
        except Exception:
            self.failure = traceback.format_exc()
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        quiet = logging.getLogger("groundstation.web")
        quiet.propagate = False
        quiet.addHandler(logging.NullHandler())
        listening = serve(
            self._attend,
            sock=self._socket,
            origins=self._origins,
            process_request=self._respond,
            max_size=LONGEST,
            server_header=None,
            logger=quiet,
            close_timeout=0.5,
        )
        async with listening:
            await self._ended.wait()

    def _respond(self, connection: ServerConnection, request: Request) -> Response | None:
        """Return the page; None opens the WebSocket."""
        # A foreign name that resolves to this machine (DNS rebinding) is not served.
        if request.headers.get("Host") not in self._hosts:
            return connection.respond(403, "unknown host\n")
        if request.path == SOCKET:
            return None
        if request.path != "/":
            return connection.respond(404, "not found\n")
        headers = Headers(SAFE | {"Content-Length": str(len(self._page))})
        return Response(200, "OK", headers, self._page)

    async def _attend(self, browser: ServerConnection) -> None:
        receiving = asyncio.create_task(self._receive(browser))
        try:
            cursor = Cursor()
            while True:
                text, cursor = self._feed.message(cursor)
                await browser.send(text)
                await asyncio.sleep(PERIOD)
        except ConnectionClosed:
            pass
        except Exception:
            self.failure = traceback.format_exc()
        finally:
            receiving.cancel()

    async def _receive(self, browser: ServerConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            async for text in browser:
                command = self._accepted(text)
                if command is not None:
                    self._commands.put(command)

    def _accepted(self, text: str | bytes) -> WebCommand | None:
        """Return the command of a message; None without the token, or if it is malformed."""
        try:
            message: Any = json.loads(text)
        except ValueError:
            return None
        if not isinstance(message, dict):
            return None
        token, name, argument = (message.get(key, "") for key in ("token", "command", "argument"))
        if not all(isinstance(one, str) for one in (token, name, argument)):
            return None
        if not secrets.compare_digest(token.encode(), self.token.encode()):
            return None
        return WebCommand(name, argument)
