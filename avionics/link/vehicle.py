"""Interface of the flight computer to the link, and identity of the vehicle."""

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
"""reason of a denial without sensor frames: the command would take effect at any later time"""
PATIENT = frozenset({CommandKind.DISARM, CommandKind.KILL, CommandKind.LINK_LOST, CommandKind.LINK_REGAINED})
"""commands accepted without sensor frames: those that stop the wings, and the state of the link"""


class Parameter(NamedTuple):
    """Entry of the parameter table."""

    name: str
    """-; at most 16 characters of ASCII, the limit of MAVLink"""
    value: float
    """in its unit"""
    minimum: float
    """in its unit; a smaller value is rejected"""
    maximum: float
    """in its unit; a larger value is rejected"""
    unit: str = ""
    """of value and limits, empty for none"""
    description: str = ""
    """-; one sentence for component metadata"""
    key: str = ""
    """-; section and key in the vehicle file, as ``pitch.proportional``"""
    is_integer: bool = False
    """-; True if only integers are accepted"""
    is_locked_armed: bool = False
    """-; True if the parameter can be set only while disarmed"""
    choices: tuple[tuple[int, str], ...] = ()
    """-; meaning of each value, empty for a measure"""


class Home(NamedTuple):
    """Reference position of north and east."""

    latitude: float
    """rad; WGS-84"""
    longitude: float
    """rad; WGS-84"""
    altitude: float
    """m; altitude above mean sea level at which ``Altitude.altitude`` is 0"""


class VehicleView(Protocol):
    """Read access to the flight computer after its last tick."""

    @property
    def time_us(self) -> int:
        """Time (us) of the last tick since boot."""

    @property
    def mode(self) -> Mode:
        """Flight mode."""

    @property
    def armed(self) -> bool:
        """True if the wings may move."""

    @property
    def mission(self) -> Mission:
        """Mission on board."""

    @property
    def fence(self) -> Fence:
        """Fence of the plan on board."""

    @property
    def rally(self) -> Rally:
        """Rally points on board."""

    @property
    def destination(self) -> tuple[float, float] | None:
        """Target position or circle center (m, north and east of home), None without one."""

    @property
    def home(self) -> Home | None:
        """Home position, None before the first fix."""

    @property
    def parameters(self) -> Sequence[Parameter]:
        """Parameter table; names and order are constant during a flight."""

    def latest(self, topic: Topic[T]) -> T | None:
        """Return the last message of ``topic``, or None before the first."""

    def events(self, after: int) -> Sequence[Event]:
        """Return the events since boot without the first ``after``."""

    def refusal(self, command: Command) -> str:
        """Return why the flight core would deny ``command`` now; empty if accepted.

        The result is `NO_FRAMES` while it does not tick.
        """


class Storage(Protocol):
    """Persistent storage of parameters, implemented by the owner of the files."""

    def stored(self) -> Mapping[str, float]:
        """Return the stored values that differ from those of the vehicle file.

        Raises:
            InputError: the file cannot be used.
        """

    def defaults(self) -> Mapping[str, float]:
        """Return all values of the vehicle file."""

    def save(self, values: Mapping[str, float]) -> None:
        """Store the values that differ from those of the vehicle file.

        Raises:
            OSError: the values cannot be written.
        """


class ModeNumbers(NamedTuple):
    """Representation of a flight mode on the wire."""

    mode: Mode
    custom_mode: int
    """main mode << 16 | sub mode << 24, in the layout and with the numbers of PX4"""
    standard_mode: int
    """MAV_STANDARD_MODE, 0 for none"""
    base_mode: int
    """MAV_MODE_FLAG bits that the mode implies"""
    label: str = ""
    """name if it differs from that of the flight mode"""

    @property
    def name(self) -> str:
        """Displayed name."""
        return self.label or self.mode.name


_MANUAL_INPUT, _STABILIZE, _GUIDED, _AUTO = 64, 16, 8, 4


def px4_mode(main: int, sub: int = 0) -> int:
    """Return a custom mode of PX4."""
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
"""numbers of the nearest PX4 modes; `custom_mode_map.json` lists them for MAVProxy"""

PX4_ALIASES = ((px4_mode(3), Mode.ALTITUDE_HOLD),)
"""POSCTL of PX4"""
PX4_TAKEOFF = ModeNumbers(
    Mode.AUTO, px4_mode(4, 2), mavlink.MAV_STANDARD_MODE_TAKEOFF, _STABILIZE | _GUIDED | _AUTO, "TAKEOFF"
)
"""AUTO.TAKEOFF of PX4"""

PLANE_GUIDED = ModeNumbers(Mode.OFFBOARD, 15, 0, _STABILIZE | _GUIDED, "GUIDED")
"""GUIDED of ArduPlane: it circles until it receives a setpoint; on the ground it waits for a takeoff"""

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
"""numbers of the nearest ArduPlane modes: MANUAL, FBWA, FBWB, AUTO, RTL, LOITER, AUTOLAND and GUIDED"""

PLANE_ALIASES = ((1, Mode.LOITER), (2, Mode.STABILIZED), (7, Mode.ALTITUDE_HOLD))
"""CIRCLE, STABILIZE and CRUISE of ArduPlane"""
PLANE_TAKEOFF = PX4_TAKEOFF._replace(custom_mode=13)
"""TAKEOFF of ArduPlane"""

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
    """Identity of the vehicle: all differences between the profiles."""

    system: int = 1
    component: int = 1
    autopilot: int = mavlink.MAV_AUTOPILOT_GENERIC
    type: int = mavlink.MAV_TYPE_FLAPPING_WING
    modes: tuple[ModeNumbers, ...] = (*PX4_STYLE, PX4_TAKEOFF)
    """modes; the first with a flight mode reports it, the others are labels of a part of it"""
    aliases: tuple[tuple[int, Mode], ...] = ()
    """further custom modes that may be requested; they are never reported"""
    standby_modes: tuple[int, ...] = (px4_mode(4, 3),)
    """custom modes that clients set before arming: on the ground they are reported without an effect"""
    guided: ModeNumbers | None = None
    """GUIDED of ArduPlane: it begins with a circle, and its position setpoints do not expire.

    None: OFFBOARD as in PX4, with a stream of setpoints only
    """
    takeoff: ModeNumbers = PX4_TAKEOFF
    """reported during the takeoff of a NAV_TAKEOFF command; a client that sets it commands this takeoff"""
    takeoff_frame: int = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    """MAV_FRAME of the altitude in a NAV_TAKEOFF without a frame, a COMMAND_LONG:

    MAVSDK 4.1, MAVProxy and the Wingbeat station use home as reference unless the autopilot is MAV_AUTOPILOT_PX4,
    which uses mean sea level
    """
    capabilities: int = _CAPABILITIES
    """MAV_PROTOCOL_CAPABILITY bits. All parameters are floats, so that the two encodings do not differ"""
    first_item: int = 0
    """-; wire number of the first mission item that is flown: 1 if item 0 is home"""
    version: tuple[int, int, int] = (0, 1, 0)
    """major, minor, patch"""
    uid: int = 0x77696E67
    """unique ID of the hardware"""

    def numbers(self, mode: Mode) -> ModeNumbers:
        """Return the wire representation of ``mode``."""
        return next(entry for entry in self.modes if entry.mode == mode)

    def by_custom_mode(self, custom_mode: int) -> Mode | None:
        """Return the mode of a custom mode, or None."""
        known = {**dict(self.aliases), **{entry.custom_mode: entry.mode for entry in self.modes}}
        return known.get(custom_mode)

    def by_standard_mode(self, standard_mode: int) -> Mode | None:
        """Return the mode with this MAV_STANDARD_MODE, or None."""
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
"""profiles of ``--identity``: a flapping wing with its own modes, or a fixed wing of ArduPilot or PX4"""
DEFAULT_IDENTITY = "ardupilot"
"""default profile, because QGroundControl provides no modes and guided actions for a generic autopilot"""


def load_identity(name: str) -> Identity:
    """Return the profile of this name.

    Raises:
        InputError: unknown profile; the text lists the known ones.
    """
    try:
        return PROFILES[name]
    except KeyError:
        raise InputError(f"identity {name!r} is none of {', '.join(PROFILES)}") from None


class LinkGains(NamedTuple):
    """Timing of the ground link."""

    heartbeat: float = 1.0
    """s; interval of HEARTBEAT"""
    silence: float = 5.0
    """s; time without a message of any known ground station after which the link counts as lost"""
    acquaintance: float = 3.0
    """s; minimum duration of a connection to a ground station for its loss to count"""
    retry_interval: float = 1.0
    """s; retry interval of an unanswered request in a mission transfer"""
    give_up: int = 15
    """-; unanswered requests until a mission transfer is abandoned: with losses of three in ten frames in each
    direction, one in a hundred transfers of hundreds of items"""
    yield_after: int = 3
    """-; unanswered requests until another station may begin a transfer"""
    confirm: float = 1.0
    """s; timeout for the flight core to accept a parameter or a mission"""
    parameters_per_step: int = 8
    """-; parameters sent per step on a link during list transfers, limited for the load of link and tick; 2000/s with
    a poll in each tick"""
