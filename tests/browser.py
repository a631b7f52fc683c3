"""A headless Chromium that is driven through a pair of pipes: the DevTools protocol, one JSON document a message.

https://chromedevtools.github.io/devtools-protocol
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE = 60.0
"""s; for any answer"""


def find_browser() -> str | None:
    """The program that `WINGBEAT_CHROMIUM` names, else one that is installed."""
    chosen = os.environ.get("WINGBEAT_CHROMIUM")
    return chosen or next((found for name in NAMES if (found := shutil.which(name))), None)


class Browser:
    """One page; `observed` has every event that the browser told."""

    def __init__(self, program: str, profile: Path) -> None:
        ours_in, theirs_out = os.pipe()
        theirs_in, ours_out = os.pipe()
        ends = [_high(theirs_in), _high(theirs_out)]

        def hand_over() -> None:
            # The browser reads its third and writes its fourth descriptor.
            os.dup2(ends[0], 3)
            os.dup2(ends[1], 4)

        self._process = subprocess.Popen(
            [program, *OPTIONS, f"--user-data-dir={profile}", "about:blank"],
            preexec_fn=hand_over,
            pass_fds=(3, 4),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        for end in ends:
            os.close(end)
        self._in, self._out = ours_in, ours_out
        self._rest = b""
        self._number = 0
        self._session = ""
        self.observed: list[dict[str, Any]] = []
        page = next(t for t in self.send_request("Target.getTargets")["targetInfos"] if t["type"] == "page")
        attached = self.send_request("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.send_request(f"{domain}.enable")

    def send_request(self, method: str, **parameters: Any) -> Any:
        """The answer to one request."""
        self._number += 1
        request: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            request["sessionId"] = self._session
        os.write(self._out, json.dumps(request).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self.observed.append(answer)

    def open(self, path: Path) -> None:
        """Load a file and wait until its script has put the page together, or has failed to."""
        self.send_request("Page.navigate", url=path.resolve().as_uri())
        ready = "document.getElementById('vehicle')?.textContent !== '' && document.readyState === 'complete'"
        limit = time.monotonic() + PATIENCE
        while not self.value(ready):
            assert time.monotonic() < limit, "the page was not put together"

    def value(self, expression: str) -> Any:
        """What an expression is worth in the page; a promise is waited for."""
        done = self.send_request("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in done, done["exceptionDetails"]
        return done["result"].get("value")

    def events(self, *methods: str) -> list[Any]:
        """Parameters of the events of these names so far."""
        return [event["params"] for event in self.observed if event.get("method") in methods]

    def close(self) -> None:
        """End the browser."""
        self._session = ""
        with contextlib.suppress(OSError, AssertionError):
            self.send_request("Browser.close")
        for end in (self._in, self._out):
            os.close(end)
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            ready, _, _ = select.select([self._in], [], [], PATIENCE)
            assert ready, "the browser does not answer"
            data = os.read(self._in, 1 << 20)
            assert data, "the browser went away"
            self._rest += data
        message, _, self._rest = self._rest.partition(b"\0")
        decoded: dict[str, Any] = json.loads(message)
        return decoded


OPTIONS = (
    "--headless",
    "--remote-debugging-pipe",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--window-size=1400,900",
)


def _high(descriptor: int) -> int:
    """The same end under a number that is not taken by what the browser is given."""
    moved = fcntl.fcntl(descriptor, fcntl.F_DUPFD, 10)
    os.close(descriptor)
    return moved


@contextlib.contextmanager
def opened(program: str, profile: Path) -> Iterator[Browser]:
    browser = Browser(program, profile)
    try:
        yield browser
    finally:
        browser.close()
