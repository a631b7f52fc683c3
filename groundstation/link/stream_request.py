"""Message requests to vehicles of other autopilots for the screen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from avionics.link.dialect import mavlink
from groundstation.link.commands import CommandExchange
from groundstation.link.exchange import Outgoing, Progress, Target


class Stream(NamedTuple):
    """Message on the screen with its requested rate."""

    name: str
    number: int
    """-; MAVLink message id"""
    rate: float
    """Hz"""


STREAMS = (
    Stream("ATTITUDE", mavlink.MAVLINK_MSG_ID_ATTITUDE, 10.0),
    Stream("VFR_HUD", mavlink.MAVLINK_MSG_ID_VFR_HUD, 4.0),
    Stream("GLOBAL_POSITION_INT", mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, 4.0),
    Stream("NAV_CONTROLLER_OUTPUT", mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT, 2.0),
    Stream("SYS_STATUS", mavlink.MAVLINK_MSG_ID_SYS_STATUS, 1.0),
    Stream("BATTERY_STATUS", mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, 1.0),
    Stream("GPS_RAW_INT", mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, 1.0),
    Stream("MISSION_CURRENT", mavlink.MAVLINK_MSG_ID_MISSION_CURRENT, 1.0),
)
"""about 1 kB/s in total, a fifth of the capacity of a radio of 57,600 baud"""
GROUPS = (
    (mavlink.MAV_DATA_STREAM_EXTRA1, 10),
    (mavlink.MAV_DATA_STREAM_EXTRA2, 4),
    (mavlink.MAV_DATA_STREAM_POSITION, 4),
    (mavlink.MAV_DATA_STREAM_EXTENDED_STATUS, 1),
    (mavlink.MAV_DATA_STREAM_EXTRA3, 1),
)
"""MAV_DATA_STREAM and Hz: the same rates for vehicles without SET_MESSAGE_INTERVAL"""


class StreamRequest(NamedTuple):
    """SET_MESSAGE_INTERVAL for each message; REQUEST_DATA_STREAM, which has no response, for older vehicles."""

    target: Target
    pending: tuple[Stream, ...]
    """-; messages not yet requested"""
    refused: frozenset[str] = frozenset()
    """names of messages that the vehicle does not send"""
    command: CommandExchange | None = None
    failure: str = ""

    @property
    def finished(self) -> bool:
        """Whether all messages were requested."""
        return not self.pending

    def progress(self) -> Progress:
        """Messages not yet requested."""
        return Progress(0, len(self.pending))

    def step(self, now: float, message: Any | None) -> tuple[StreamRequest, Outgoing]:
        """See `Exchange.step`."""
        if self.finished:
            return self, ()
        first = self.pending[0]
        command, outgoing = (self.command or self._request(first)).step(now, message)
        if not command.finished:
            return self._replace(command=command), outgoing
        if command.result == mavlink.MAV_RESULT_UNSUPPORTED:
            return self._replace(pending=()), self._groups()
        refused = self.refused if command.accepted else self.refused | {first.name}
        return self._replace(pending=self.pending[1:], refused=refused, command=None), outgoing

    def _request(self, stream: Stream) -> CommandExchange:
        interval = (float(stream.number), 1e6 / stream.rate)
        return CommandExchange(self.target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, interval)

    def _groups(self) -> Outgoing:
        return tuple(
            mavlink.MAVLink_request_data_stream_message(*self.target, group, rate, 1) for group, rate in GROUPS
        )


def too_slow(rates: dict[str, float], without: frozenset[str] = frozenset()) -> Sequence[Stream]:
    """Return the `STREAMS` below half of their rate (``rates`` in Hz), except those in ``without``."""
    return [each for each in STREAMS if rates.get(each.name, 0.0) < 0.5 * each.rate and each.name not in without]
