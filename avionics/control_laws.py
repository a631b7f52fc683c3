"""Table of control laws.

``law = "..."`` in the section of a loop of the vehicle file selects one. The laws of a loop share its `Gains`,
`State` and `Measured`, so that a law needs no parameters or topics of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, Generic, NamedTuple, TypeVar

from avionics.gains import FlightGains
from avionics.guidance import altitude, heading
from avionics.messages import AltitudeStatus, HeadingStatus, PitchStatus, RollStatus
from avionics.stabilization import i_pd, pitch, roll
from wingbeat.errors import InputError
from wingbeat.text import did_you_mean

Step = TypeVar("Step")
Hold = TypeVar("Hold")
Follow = TypeVar("Follow")


class Law(NamedTuple, Generic[Step, Hold, Follow]):
    """Control law of a loop."""

    text: str
    """description in one line"""
    step: Step
    """closed loop"""
    hold_trim: Hold
    """mean command during an identification input"""
    follow: Follow
    """open loop: tracks a command of the pilot or of the ground station"""
    setpoint_weight: float = 1.0
    """-; fraction of the proportional term that acts on the setpoint: 1 in a PID law; used by `tune`"""


PitchStep = Callable[[pitch.Gains, pitch.State, int, float, float, pitch.Measured], tuple[pitch.State, PitchStatus]]
RollStep = Callable[[roll.Gains, roll.State, int, float, float, roll.Measured], tuple[roll.State, RollStatus]]
RollHold = Callable[[roll.Gains, roll.State, int, float, roll.Measured], tuple[roll.State, RollStatus]]
RollFollow = Callable[[int, float], tuple[roll.State, RollStatus]]
AltitudeStep = Callable[
    [altitude.Gains, altitude.State, int, float, float, altitude.Measured], tuple[altitude.State, AltitudeStatus]
]
AltitudeHold = Callable[[altitude.State, int, float, altitude.Measured], tuple[altitude.State, AltitudeStatus]]
AltitudeFollow = Callable[
    [altitude.Gains, altitude.State, int, float, altitude.DirectCommand], tuple[altitude.State, AltitudeStatus]
]
HeadingStep = Callable[
    [heading.Gains, heading.State, int, float, float, heading.Measured], tuple[heading.State, HeadingStatus]
]

PITCH: Final[Mapping[str, Law[PitchStep, PitchStep, PitchStep]]] = MappingProxyType({
    "pid": Law("PID, damping on the measured pitch rate", pitch.step, pitch.hold_trim, pitch.follow),
    "i_pd": Law(
        "I-PD: PID with proportional term and damping on the measurement", i_pd.step, i_pd.hold_trim, i_pd.follow, 0.0
    ),
})  # fmt: skip
ROLL: Final[Mapping[str, Law[RollStep, RollHold, RollFollow]]] = MappingProxyType({
    "pid": Law("PID, damping on the measured roll rate", roll.step, roll.hold_trim, roll.follow),
})  # fmt: skip
ALTITUDE: Final[Mapping[str, Law[AltitudeStep, AltitudeHold, AltitudeFollow]]] = MappingProxyType({
    "cascade": Law(
        "P on the altitude around PI with feedforward on the climb rate",
        altitude.step, altitude.hold_trim, altitude.follow,
    ),
})  # fmt: skip
HEADING: Final[Mapping[str, Law[HeadingStep, None, HeadingStep]]] = MappingProxyType({
    "pi": Law("PI, bank proportional to the ground speed", heading.step, None, heading.follow),
})  # fmt: skip
LOOPS: Final[Mapping[str, Mapping[str, Law[Any, Any, Any]]]] = MappingProxyType(
    {"pitch": PITCH, "roll": ROLL, "altitude": ALTITUDE, "heading": HEADING}
)
"""laws by name, by section of the vehicle file"""


def check(gains: FlightGains) -> None:
    """Check that every loop has a law of the table.

    Raises:
        InputError: a loop has an unknown law.
    """
    for section, laws in LOOPS.items():
        law = getattr(gains, section).law
        if law not in laws:
            raise InputError(f'{section}.law = "{law}" is unknown{did_you_mean(law, laws)}; known: {", ".join(laws)}')
