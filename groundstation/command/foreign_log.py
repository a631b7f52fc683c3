"""Logs of other autopilots as input of a command: imported for its duration, the elevator from what they record."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from avionics import topics
from logs.importing.excitation import FULL_DEFLECTION
from logs.reader import Log, open_log

SUFFIXES = (".ulg", ".bin", ".tlog")
ELEVATORS = (
    ("/ulg/vehicle_torque_setpoint", "xyz[1]", FULL_DEFLECTION),
    ("/ulg/actuator_controls_0", "control[1]", FULL_DEFLECTION),
    ("/dataflash/AETR", "Elev", FULL_DEFLECTION / 4500.0),
)
"""topic, field and rad per unit of the pitch command before the mixer; positive pitches the nose up"""


@contextlib.contextmanager
def opened_log(path: Path) -> Iterator[Log]:
    """Open a log; one of another autopilot is imported to a temporary file first, of several boots the longest.

    Raises:
        InputError: it cannot be read.
    """
    if path.suffix.lower() not in SUFFIXES:
        with open_log(path) as log:
            yield log
        return
    from logs.importing.log_import import Choice, import_log  # its readers are heavy

    with TemporaryDirectory(prefix="wingbeat-import-") as folder:
        report = import_log(Choice(path, Path(folder) / f"{path.stem}.mcap"))
        longest = max((report, *report.later_boots), key=lambda one: one.messages)
        with open_log(Path(longest.file)) as log:
            yield log


def recorded_elevator(log: Log) -> tuple[str, str] | None:
    """Return ``TOPIC.FIELD`` and rad per unit of the pitch command; None if an angle or nothing is recorded."""
    if topics.ACTUATORS.name in log.topics:
        return None
    for topic, field, scale in ELEVATORS:
        if topic in log.topics:
            return f"{topic}.{field}", repr(scale)
    return None
