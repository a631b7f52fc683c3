"""What the logger processor and the simulated world hand messages to; the composing command injects one."""

from __future__ import annotations

from typing import Any, Protocol

from wingbeat.topic import Topic


class Recorder(Protocol):
    """Takes every message of a flight; an implementation must not raise during a flight."""

    @property
    def failure(self) -> str:
        """Why nothing is recorded any more, one line; empty while it is."""

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Store one message; its ``time_us`` is the time stamp."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Store a file beside the messages: vehicle file, mission, calibration."""

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store metadata: software version, seed, initial parameters."""

    def close(self) -> None:
        """Finish the recording; further calls do nothing."""


class NullRecorder:
    """Forgets everything: for flights whose caller reads the state directly."""

    failure = ""
    """nothing can fail"""

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Ignore the message."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Ignore the file."""

    def note(self, name: str, values: dict[str, str]) -> None:
        """Ignore the metadata."""

    def close(self) -> None:
        """Nothing to finish."""
