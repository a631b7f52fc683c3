"""Interface of the recorder that the logger processor and the simulator write to."""

from __future__ import annotations

from typing import Any, Protocol

from wingbeat.topic import Topic


class Recorder(Protocol):
    """Recorder of all messages of a flight; it must not raise exceptions in flight."""

    @property
    def failure(self) -> str:
        """Reason in one line if recording has stopped, else empty."""

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Store one message; its ``time_us`` is the timestamp."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Store an attached file: vehicle file, mission, calibration."""

    def note(self, name: str, values: dict[str, str]) -> None:
        """Store metadata: software version, seed, initial parameters."""

    def close(self) -> None:
        """Finish the recording; further calls have no effect."""


class NullRecorder:
    """Recorder without an output, for callers that read the state directly."""

    failure = ""
    """always empty"""

    def record(self, topic: Topic[Any], message: Any) -> None:
        """Ignore the message."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Ignore the file."""

    def note(self, name: str, values: dict[str, str]) -> None:
        """Ignore the metadata."""

    def close(self) -> None:
        """Return; there is no recording to finish."""
