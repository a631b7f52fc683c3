"""Names of recordings, metadata, attachments and vehicle files."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from logs.new_files import locked_name, numbered

RECORDINGS = Path("recordings")

WORLD_VEHICLE = "world_vehicle.toml"
"""Name of the attachment in which the world leaves its vehicle file."""
WORLD = "wingbeat.world"
"""Name of the metadata record in which the world notes what a flight chose beside that file."""
AERODYNAMICS = "aerodynamics"
"""Key of `WORLD`: the aerodynamic model that was flown, which need not be the file's."""
STICKS = "sticks.csv"
"""Name of the attachment in which the world leaves how a scripted pilot moved his transmitter."""
AUTOPILOT = "wingbeat.autopilot"
"""Name of the metadata record of a flight of PX4 or ArduPilot: which one, and how its outputs are assigned."""
PARAMETERS = "wingbeat.parameters"
"""Name of the metadata record in which the flight computer notes every parameter at boot."""
FLIGHT_VEHICLE = "avionics_vehicle.toml"
"""Name of the attachment in which the flight computer leaves its vehicle file."""
MISSION = "mission.json"
"""Name of the attachment in which the flight computer leaves the mission it began with."""

JOINED = "wingbeat.joined"
"""Name of the metadata record in which a joined log notes what was wrong with its parts, by their names."""

FAULTS = "wingbeat.faults"
"""Name of the metadata record in which a joined log notes what the view of ``wingbeat fly`` raised."""


PARTS = (".world.mcap", ".avionics.mcap")
"""How the names of the recordings of world and flight computer end that are joined to one of the same name."""


def files_of(recording: Path) -> tuple[Path, ...]:
    """Of a flight: what is joined, the world's part, the flight computer's; of any other recording the first."""
    return (recording, *(recording.with_suffix(ending) for ending in PARTS))


def parts_of(recording: Path) -> list[Path]:
    """The recordings of world and flight computer that exist beside the name of a flight's joined log."""
    return [part for part in files_of(recording)[1:] if part.is_file()]


@contextlib.contextmanager
def reserved(vehicle: str, when: datetime | None = None, folder: Path = RECORDINGS) -> Iterator[Path]:
    """A path of which there are no files, and that no other program takes as long as the context lasts.

    ``recordings/robo_raven_ii_d-20261121-131500.mcap``; the same second again gives ``-2``, ``-3`` and so on.

    Args:
        vehicle: name, or path of a vehicle file.
        when: local time of the flight; now when not given.
        folder: where recordings go; it is made.

    Raises:
        InputError: the folder cannot be made or written to.
    """
    for path in _free(vehicle, when, folder):
        with locked_name(path) as ours:
            # Looked at again: who held the name before may have left files of it.
            if ours and not any(file.exists() for file in files_of(path)):
                yield path
                return


def _free(vehicle: str, when: datetime | None, folder: Path) -> Iterator[Path]:
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", Path(vehicle).name.removesuffix(".toml")).strip("._-") or "flight"
    stamp = (when or datetime.now()).strftime("%Y%m%d-%H%M%S")
    for path in numbered(folder / f"{name}-{stamp}.mcap"):
        if not any(file.exists() for file in files_of(path)):
            yield path


def vehicle_files(vehicle: str) -> tuple[str, str]:
    """What the world and what the flight computer load: a name for both, or the two files of a folder."""
    folder = Path(vehicle)
    if folder.is_dir():
        return str(folder / "world.toml"), str(folder / "avionics.toml")
    return vehicle, vehicle
