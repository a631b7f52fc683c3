"""MCAP recording of all messages of a link.

Each kind of message has a channel ``/mavlink/NAME``; what no dialect knows is in ``/mavlink/unknown`` as it came,
what we sent in ``/ground/sent``; the vehicle's own topics are beside them as far as its telemetry gives them.
Times are those of the vehicle: by its stamps, and between them by the ground's clock. A vehicle that boots anew
begins a file.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

from avionics import topics
from avionics.link.dialect import mavlink
from groundstation.link import mavlink_topics, modes, vehicle_topics
from groundstation.link.frames import Arrival
from groundstation.link.vehicle_state import VehicleState, new_events, receive
from logs.codecs import Document
from logs.names import RECORDINGS, reserved
from logs.recorder import IN_FLIGHT, McapRecorder, Writing
from logs.scene import PLAIN_BIRD, SceneRecorder
from wingbeat.errors import InputError
from wingbeat.message import Event
from wingbeat.topic import Topic

PATIENCE = 3.0
"""s; timeout of the vehicle's identity and time, after which the file is begun without them"""
REBOOT = 5.0
"""s; backward step of a time stamp that indicates a reboot of the vehicle"""
SENT = Topic("/ground/sent", Document, mavlink_topics.FIRST_CHANNEL, 0.0, deterministic=False)
UNKNOWN = Topic("/mavlink/unknown", Document, mavlink_topics.FIRST_CHANNEL + 1, 0.0, deterministic=False)
NOT_KEPT = frozenset(("HEARTBEAT", "TIMESYNC", "PING", "SETUP_SIGNING"))
"""sent messages that are not recorded: those of every second, and a key"""
_WRITING = Writing(IN_FLIGHT, account=topics.RECORDER)
STATEFUL = frozenset(
    (
        "HEARTBEAT",
        "STATUSTEXT",
        "SYSTEM_TIME",
        "GLOBAL_POSITION_INT",
        "AUTOPILOT_VERSION",
        "WINGBEAT_NAVIGATION",
        "WINGBEAT_WING_STATE",
    )
)
"""messages needed to interpret others"""


class Where(NamedTuple):
    """Location of a recording."""

    url: str
    """-; of the link, recorded in the file"""
    file: Path | None = None
    """of the first recording (default: a generated name in ``folder``)"""
    folder: Path = RECORDINGS
    verb: str = ""
    """-; command-line verb, a part of the generated name; empty for none"""


class _Sent(NamedTuple):
    """Sent message."""

    epoch_ns: int
    message: Any


class VehicleTime:
    """Vehicle clock estimated from the latest ``time_boot_ms``."""

    def __init__(self) -> None:
        self.offset: float | None = None
        """s; vehicle clock minus ground clock"""
        self._last: dict[int, float] = {}

    def read(self, arrival: Arrival) -> bool:
        """Process the time stamp of a message, if any; return whether the vehicle has rebooted."""
        stamp = boot_stamp(arrival.message)
        if stamp is None:
            return False
        offset = stamp - arrival.at
        anew = self.offset is not None and offset < self.offset - REBOOT
        self.offset = offset
        return anew

    def of(self, arrival: Arrival) -> int:
        """Return us since boot of a message: its time stamp, or the ground time, nondecreasing in one channel."""
        stamp = self._stamp(arrival)
        number = arrival.frame.message_id
        at = max(self.at(arrival.at), self._last.get(number, 0.0)) if stamp is None else stamp
        self._last[number] = at
        return round(at * 1e6)

    def _stamp(self, arrival: Arrival) -> float | None:
        """Return s since boot; ``time_usec``, whose epoch varies, counts only if it is close to the boot time."""
        stamp = boot_stamp(arrival.message)
        microseconds = getattr(arrival.message, "time_usec", None)
        if stamp is not None or not microseconds:
            return stamp
        return microseconds * 1e-6 if abs(microseconds * 1e-6 - self.at(arrival.at)) < REBOOT else None

    def at(self, now: float) -> float:
        """Return s since boot at ``now`` of the ground clock."""
        return max(now + (self.offset or 0.0), 0.0)


def boot_stamp(message: Any | None) -> float | None:
    """Return the time stamp of a message in s since boot; None without one.

    SYSTEM_TIME is excluded: Wingbeat sends it as the time stamp of the next message, which may be older.
    """
    if message is None or message.get_type() == "SYSTEM_TIME":
        return None
    milliseconds = getattr(message, "time_boot_ms", None)
    return milliseconds * 1e-3 if milliseconds else None


class Recording:
    """Recorder of all frames and sent messages of a link; no method raises during recording.

    The file is created when the vehicle's identity and time are known, or after a timeout; earlier messages are
    included. Without received messages there is no file.
    """

    def __init__(self, where: Where, epoch_ns: Callable[[], int] = time.time_ns) -> None:
        self.where = where
        self.failure = ""
        """-; reason why recording ended, one line"""
        self.messages = 0
        """-; number of recorded messages, without those of the vehicle's topics"""
        self.files: list[Path] = []
        """files so far: one for each boot of the vehicle"""
        self._epoch_ns = epoch_ns
        self._recorder: McapRecorder | None = None
        self._systems: SceneRecorder | None = None
        self._waiting: list[Arrival] = []
        self._sent_before: list[_Sent] = []
        self._time = VehicleTime()
        self._state = VehicleState()
        self._announced = 0
        self._topics: dict[int, Topic[Any]] = {}

    @property
    def path(self) -> Path | None:
        """Path of the current file, None before the first."""
        return None if self._recorder is None else self._recorder.path

    def handle_frame(self, arrival: Arrival) -> None:
        """Record one received frame, without signing keys."""
        if self.failure or arrival.frame.message_id == mavlink.MAVLINK_MSG_ID_SETUP_SIGNING:
            return
        ours = arrival.frame.system == self._state.system
        if ours and self._time.read(arrival) and self._recorder is not None:
            self._restart()
        if arrival.message is not None and arrival.message.get_type() in STATEFUL:
            self._state = receive(self._state, arrival.message, arrival.at)
        if self._recorder is not None:
            self._record(arrival)
            return
        self._waiting.append(arrival)
        if self._is_ready(arrival.at):
            self._begin(arrival.at)

    def sent(self, message: Any) -> None:
        """Record one sent message, without those of every second and signing keys."""
        if self.failure or message.get_type() in NOT_KEPT:
            return
        sent = _Sent(self._epoch_ns(), message)
        if self._recorder is None:
            self._sent_before.append(sent)
        else:
            self._record_sent(self._recorder, sent)

    def close(self) -> None:
        """Close the file."""
        if self._waiting:
            self._begin(self._waiting[-1].at)
        if self._recorder is not None:
            self._recorder.close()
            self.failure = self.failure or self._recorder.failure

    def _is_ready(self, now: float) -> bool:
        waited = now - self._waiting[0].at
        known = self._state.system is not None and self._time.offset is not None
        return known or waited >= PATIENCE

    def _begin(self, now: float) -> None:
        try:
            self._recorder = self._open(now)
        except InputError as reason:
            self.failure = str(reason)
            self._waiting, self._sent_before = [], []
            return
        self.files.append(self._recorder.path)
        self._systems = SceneRecorder(self._recorder, PLAIN_BIRD, self._recorder.start_epoch_ns, estimated=True)
        waiting, self._waiting = self._waiting, []
        for arrival in waiting:
            self._record(arrival)
        spoken, self._sent_before = self._sent_before, []
        for sent in spoken:
            self._record_sent(self._recorder, sent)

    def _open(self, now: float) -> McapRecorder:
        state = self._state
        name = "link" if state.system is None else f"{modes.type_name(state.vehicle_type)}-{state.system}"
        if self._time.offset is None:
            self._time.offset = -self._waiting[0].at
        boot_ns = self._epoch_ns() - round(self._time.at(now) * 1e9)
        recorder = self._create("-".join(filter(None, ("gcs", name, self.where.verb))), boot_ns)
        autopilot = modes.autopilot_name(state.autopilot)
        notes = {"version": version("wingbeat"), "url": self.where.url, "vehicle": name, "autopilot": autopilot}
        recorder.note("wingbeat.groundstation", notes)
        return recorder

    def _create(self, name: str, boot_ns: int) -> McapRecorder:
        """Create a file with a locked name."""
        if self.where.file is not None:
            return McapRecorder(self.where.file, start_epoch_ns=boot_ns, writing=_WRITING)
        with reserved(name.replace(" ", "_"), folder=self.where.folder) as path:
            return McapRecorder(path, start_epoch_ns=boot_ns, writing=_WRITING)

    def _restart(self) -> None:
        """Begin a new file after a reboot: the time in a file is since one boot."""
        assert self._recorder is not None
        self._recorder.close()
        self._recorder = None
        self._topics = {}
        offset, self._time = self._time.offset, VehicleTime()
        self._time.offset = offset
        self.where = self.where._replace(file=None)

    def _record_sent(self, recorder: McapRecorder, sent: _Sent) -> None:
        values = {"message": sent.message.get_type(), **mavlink_topics.document(sent.message)}
        now = (sent.epoch_ns - recorder.start_epoch_ns) // 1000
        recorder.record(SENT, Document(max(now, 0), values))

    def _record(self, arrival: Arrival) -> None:
        assert self._recorder is not None
        self.messages += 1
        time_us = self._time.of(arrival)
        message, frame = arrival.message, arrival.frame
        if message is None:
            values = {"id": frame.message_id, "system": frame.system, "component": frame.component}
            self._recorder.record(UNKNOWN, Document(time_us, {**values, "frame": frame.raw.hex()}))
            return
        topic = self._topic(frame.message_id, message)
        self._recorder.record(topic, mavlink_topics.encode(topic, message, time_us))
        if frame.system == self._state.system:
            self._record_as_vehicle(message, time_us)

    def _topic(self, number: int, message: Any) -> Topic[Any]:
        topic = self._topics.get(number)
        if topic is None:
            channel = UNKNOWN.channel + 1 + len(self._topics)
            topic = self._topics[number] = mavlink_topics.topic_of(type(message), channel)
        return topic

    def _record_as_vehicle(self, message: Any, time_us: int) -> None:
        assert self._systems is not None
        entry = vehicle_topics.entry_of(message, time_us, self._state)
        if entry is not None:
            self._systems.record(entry.topic, entry.message)
        for heard in new_events(self._state, self._announced):
            at = time_us if heard.time is None else round(heard.time * 1e6)
            self._systems.record(vehicle_topics.EVENTS, Event(at, heard.severity, "vehicle", heard.text))
        self._announced = self._state.text_count
