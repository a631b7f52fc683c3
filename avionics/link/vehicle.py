"""What the link reads of the flight computer, and who the flight computer says that it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, TypeVar

from avionics.guidance.mission import Fence, Mission, Rally
from avionics.link.dialect import mavlink
from avionics.messages import Command, CommandKind, Mode
from wingbeat.errors import InputError
from wingbeat.message import Event
from wingbeat.topic import Topic

T = TypeVar("T")

NO_FRAMES = "no sensor frames"
"""Why nothing is taken while the board is silent: it would be obeyed whenever the board comes back."""
PATIENT = frozenset({CommandKind.DISARM, CommandKind.KILL, CommandKind.LINK_LOST, CommandKind.LINK_REGAINED})
"""What is taken all the same: what stops the wings, late rather than never, and how the link is."""


class Parameter(NamedTuple):
    """One entry of the parameter table."""

    name: str
    """-; at most 16 characters of ASCII, MAVLink's limit"""
    value: float
    """in its unit"""
    minimum: float
    """in its unit; a smaller value is refused"""
    maximum: float
    """in its unit; a larger value is refused"""
    unit: str = ""
    """of value and limits, empty for none"""
    description: str = ""
    """-; one sentence for component metadata"""
    key: str = ""
    """-; section and key in the vehicle file, as ``pitch.proportional``"""
    is_integer: bool = False
    """-; whether only whole numbers are accepted"""
    is_locked_armed: bool = False
    """-; whether the parameter can be set only while disarmed"""
    choices: tuple[tuple[int, str], ...] = ()
    """-; meaning of each value, empty for a measure"""


class Home(NamedTuple):
    """The place that north and east are counted from."""

    latitude: float
    """rad; WGS-84"""
    longitude: float
    """rad; WGS-84"""
    altitude: float
    """m; above mean sea level, where ``Altitude.altitude`` is 0"""


class VehicleView(Protocol):
    """Read access to the flight computer, always as of its last tick; the link changes nothing through it."""

    @property
    def time_us(self) -> int:
        """us; since boot, of the last tick."""

    @property
    def mode(self) -> Mode:
        """Flight mode."""

    @property
    def armed(self) -> bool:
        """The wings may move."""

    @property
    def mission(self) -> Mission:
        """The mission on board."""

    @property
    def fence(self) -> Fence:
        """The plan's fence on board."""

    @property
    def rally(self) -> Rally:
        """The rally points on board."""

    @property
    def destination(self) -> tuple[float, float] | None:
        """North and east (m from home) of the position or circle center flown to; None without one."""

    @property
    def home(self) -> Home | None:
        """None before the first fix."""

    @property
    def parameters(self) -> Sequence[Parameter]:
        """The parameter table; names and order stay the same for the whole flight."""

    def latest(self, topic: Topic[T]) -> T | None:
        """The last message of ``topic``, or None before the first."""

    def events(self, after: int) -> Sequence[Event]:
        """The events since boot but for the first ``after``."""

    def refusal(self, command: Command) -> str:
        """Why the flight core would refuse ``command`` now, one line; empty when it would take it.

        `NO_FRAMES` while it does not tick.
        """


class Storage(Protocol):
    """Where parameters outlive a restart; its owner is at the edge, with the files."""

    def stored(self) -> Mapping[str, float]:
        """The values in the file that differ from the vehicle's; raises `InputError` where it cannot be used."""

    def defaults(self) -> Mapping[str, float]:
        """Every value of the vehicle file."""

    def save(self, values: Mapping[str, float]) -> None:
        """Write what differs from the vehicle's; raises `OSError`."""


class ModeNumbers(NamedTuple):
    """How a flight mode is written on the wire."""

    mode: Mode
    custom_mode: int
    """main mode << 16 | sub mode << 24, PX4's layout with PX4's numbers"""
    standard_mode: int
    """MAV_STANDARD_MODE, 0 for none"""
    base_mode: int
    """MAV_MODE_FLAG bits that the mode implies"""
    label: str = ""
    """name of one that is not just the flight mode"""

    @property
    def name(self) -> str:
        """What people call it."""
        return self.label or self.mode.name


_MANUAL_INPUT, _STABILIZE, _GUIDED, _AUTO = 64, 16, 8, 4


def px4_mode(main: int, sub: int = 0) -> int:
    """PX4's custom mode."""
    return main << 16 | sub << 24


PX4_STYLE = (
    ModeNumbers(Mode.MANUAL, px4_mode(1), 0, _MANUAL_INPUT),
    ModeNumbers(Mode.STABILIZED, px4_mode(7), 0, _MANUAL_INPUT | _STABILIZE),
    ModeNumbers(Mode.ALTITUDE_HOLD, px4_mode(2), mavlink.MAV_STANDARD_MODE_ALTITUDE_HOLD, _MANUAL_INPUT | _STABILIZE),
    ModeNumbers(Mode.AUTO, px4_mode(4, 4), mavlink.MAV_STANDARD_MODE_MISSION, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.RETURN, px4_mode(4, 5), mavlink.MAV_STANDARD_MODE_SAFE_RECOVERY, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.LOITER, px4_mode(4, 3), 0, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.LAND, px4_mode(4, 6), mavlink.MAV_STANDARD_MODE_LAND, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.OFFBOARD, px4_mode(6), 0, _STABILIZE | _GUIDED),
)
"""PX4's numbers of the modes that are nearest to ours; `custom_mode_map.json` lists them for MAVProxy."""

PX4_ALIASES = ((px4_mode(3), Mode.ALTITUDE_HOLD),)
"""PX4's POSCTL."""
PX4_TAKEOFF = ModeNumbers(
    Mode.AUTO, px4_mode(4, 2), mavlink.MAV_STANDARD_MODE_TAKEOFF, _STABILIZE | _GUIDED | _AUTO, "TAKEOFF"
)
"""PX4's AUTO.TAKEOFF."""

PLANE_GUIDED = ModeNumbers(Mode.OFFBOARD, 15, 0, _STABILIZE | _GUIDED, "GUIDED")
"""ArduPlane's GUIDED: it circles until it gets a setpoint; on the ground it waits for a takeoff."""

PLANE_STYLE = (
    ModeNumbers(Mode.MANUAL, 0, 0, _MANUAL_INPUT),
    ModeNumbers(Mode.STABILIZED, 5, 0, _MANUAL_INPUT | _STABILIZE),
    ModeNumbers(Mode.ALTITUDE_HOLD, 6, mavlink.MAV_STANDARD_MODE_ALTITUDE_HOLD, _MANUAL_INPUT | _STABILIZE),
    ModeNumbers(Mode.AUTO, 10, mavlink.MAV_STANDARD_MODE_MISSION, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.RETURN, 11, mavlink.MAV_STANDARD_MODE_SAFE_RECOVERY, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.LOITER, 12, 0, _STABILIZE | _GUIDED | _AUTO),
    ModeNumbers(Mode.LAND, 26, mavlink.MAV_STANDARD_MODE_LAND, _STABILIZE | _GUIDED | _AUTO),
    PLANE_GUIDED,
)
"""ArduPlane's numbers of the modes that are nearest to ours: MANUAL, FBWA, FBWB, AUTO, RTL, LOITER, AUTOLAND and
GUIDED."""

PLANE_ALIASES = ((1, Mode.LOITER), (2, Mode.STABILIZED), (7, Mode.ALTITUDE_HOLD))
"""ArduPlane's CIRCLE, STABILIZE and CRUISE."""
PLANE_TAKEOFF = PX4_TAKEOFF._replace(custom_mode=13)
"""ArduPlane's TAKEOFF."""

_CAPABILITIES: int = (
    mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
    | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    | mavlink.MAV_PROTOCOL_CAPABILITY_FTP
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
    | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    | mavlink.MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
    | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
)


class Identity(NamedTuple):
    """Who the vehicle says that it is: all that differs from one profile to the next, so that no service asks."""

    system: int = 1
    component: int = 1
    autopilot: int = mavlink.MAV_AUTOPILOT_GENERIC
    type: int = mavlink.MAV_TYPE_FLAPPING_WING
    modes: tuple[ModeNumbers, ...] = (*PX4_STYLE, PX4_TAKEOFF)
    """the first with a flight mode reports it; the others are labels of a part of it"""
    aliases: tuple[tuple[int, Mode], ...] = ()
    """further custom modes that may be asked for; the vehicle never says that it is in one"""
    standby_modes: tuple[int, ...] = (px4_mode(4, 3),)
    """custom modes that clients set before they arm: on the ground they change nothing and are shown"""
    guided: ModeNumbers | None = None
    """ArduPlane's GUIDED: it begins with a circle, and its position setpoints do not expire. None: OFFBOARD as in
    PX4, by a stream of setpoints alone"""
    takeoff: ModeNumbers = PX4_TAKEOFF
    """reported during the takeoff of a NAV_TAKEOFF command; a client that sets it commands that takeoff"""
    takeoff_frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    """MAV_FRAME of the altitude of a NAV_TAKEOFF that names none, a COMMAND_LONG: MAVSDK 4.1, MAVProxy and our
    station count from home where the autopilot is not MAV_AUTOPILOT_PX4, which counts from the sea"""
    capabilities: int = _CAPABILITIES
    """MAV_PROTOCOL_CAPABILITY bits. All parameters are floats, so that the two encodings do not differ"""
    first_item: int = 0
    """-; number on the wire of the first mission item that is flown: 1 where item 0 is home"""
    version: tuple[int, int, int] = (0, 1, 0)
    """major, minor, patch"""
    uid: int = 0x77696E67
    """hardware's unique id"""

    def numbers(self, mode: Mode) -> ModeNumbers:
        """How ``mode`` is written on the wire."""
        return next(entry for entry in self.modes if entry.mode == mode)

    def by_custom_mode(self, custom_mode: int) -> Mode | None:
        """The mode that this custom mode asks for, or None."""
        known = {**dict(self.aliases), **{entry.custom_mode: entry.mode for entry in self.modes}}
        return known.get(custom_mode)

    def by_standard_mode(self, standard_mode: int) -> Mode | None:
        """The mode with this MAV_STANDARD_MODE, or None."""
        return next((entry.mode for entry in self.modes if 0 < entry.standard_mode == standard_mode), None)


PROFILES: dict[str, Identity] = {
    "generic": Identity(aliases=PX4_ALIASES),
    "ardupilot": Identity(
        autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        type=mavlink.MAV_TYPE_FIXED_WING,
        modes=(*PLANE_STYLE, PLANE_TAKEOFF),
        takeoff=PLANE_TAKEOFF,
        aliases=PLANE_ALIASES,
        standby_modes=(12, PLANE_GUIDED.custom_mode),
        guided=PLANE_GUIDED,
        first_item=1,
    ),
    "px4": Identity(
        autopilot=mavlink.MAV_AUTOPILOT_PX4,
        type=mavlink.MAV_TYPE_FIXED_WING,
        aliases=PX4_ALIASES,
        takeoff_frame=mavlink.MAV_FRAME_GLOBAL,
        capabilities=_CAPABILITIES & ~mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE,
    ),
}
"""What ``--identity`` chooses: a flapping wing with modes of its own, or a fixed wing of ArduPilot or PX4."""
DEFAULT_IDENTITY = "ardupilot"
"""QGroundControl gives a generic autopilot no modes and no guided actions."""


def load_identity(name: str) -> Identity:
    """The profile of this name.

    Raises:
        InputError: there is none; the text names those that there are.
    """
    try:
        return PROFILES[name]
    except KeyError:
        raise InputError(f"identity {name!r} is none of {', '.join(PROFILES)}") from None


class LinkGains(NamedTuple):
    """Times of the ground link."""

    heartbeat: float = 1.0
    """s; between two HEARTBEATs"""
    silence: float = 5.0
    """s; without a word from any ground station after one was heard, until the link counts as lost"""
    acquaintance: float = 3.0
    """s; for which a ground station must have been heard before its silence is a loss"""
    retry_interval: float = 1.0
    """s; until an unanswered request of a mission transfer is repeated"""
    give_up: int = 15
    """-; requests without an answer until a mission transfer is abandoned: where three of ten frames are lost on each
    way, one transfer in a hundred with hundreds of items"""
    yield_after: int = 3
    """-; requests without an answer until another station may begin a transfer of its own"""
    confirm: float = 1.0
    """s; for the flight core to take a parameter or a mission"""
    parameters_per_step: int = 8
    """-; parameters sent in one go on a link while lists are read, so that neither it is flooded nor a tick late,
    whoever asks; 2000/s at a poll in each tick"""
