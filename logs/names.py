"""Names of recordings, metadata, attachments and vehicle files."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path

from logs.new_files import locked_name, numbered
from wingbeat.errors import InputError

RECORDINGS = Path("recordings")

WORLD_VEHICLE = "world_vehicle.toml"
"""Name of the attachment with the vehicle file of the world."""
WORLD = "wingbeat.world"
"""Name of the metadata record with the settings of the world that override the vehicle file."""
AERODYNAMICS = "aerodynamics"
"""Key of `WORLD`: the aerodynamic model of the flight, which may differ from that of the vehicle file."""
STICKS = "sticks.csv"
"""Name of the attachment with the transmitter inputs of a scripted pilot."""
AUTOPILOT = "wingbeat.autopilot"
"""Name of the metadata record of a PX4 or ArduPilot flight: autopilot and assignment of its outputs."""
PARAMETERS = "wingbeat.parameters"
"""Name of the metadata record with every parameter of the flight computer at boot."""
FLIGHT_VEHICLE = "avionics_vehicle.toml"
"""Name of the attachment with the vehicle file of the flight computer."""
MISSION = "mission.json"
"""Name of the attachment with the initial mission of the flight computer."""

JOINED = "wingbeat.joined"
"""Name of the metadata record of a joined log with the damage of its parts, by part name."""

FAULTS = "wingbeat.faults"
"""Name of the metadata record of a joined log with the exceptions of the views of ``wingbeat fly``."""


PARTS = (".world.mcap", ".avionics.mcap")
"""Suffixes of the recordings of world and flight computer, which are joined into one of the same name."""


def files_of(recording: Path) -> tuple[Path, ...]:
    """Return the files of a flight: joined log, world's part, flight computer's part."""
    return (recording, *(recording.with_suffix(ending) for ending in PARTS))


def parts_of(recording: Path) -> list[Path]:
    """Return the existing recordings of world and flight computer of a flight."""
    return [part for part in files_of(recording)[1:] if part.is_file()]


GROUND = "gcs-"
"""beginning of the names of a ground station's recordings"""
LATEST = "latest"
"""Name of the newest recording in place of a path."""


def recording_path(name: str, folder: Path = RECORDINGS) -> Path:
    """Return the path of a recording; ``latest`` is the newest in ``folder``, unless a file has this name.

    Raises:
        InputError: ``latest``, and there is no recording.
    """
    path = Path(name)
    if name != LATEST or path.exists():
        return path
    flights = [one for one in folder.glob("*.mcap") if not one.name.endswith(PARTS)]
    if not flights:
        raise InputError(f"no recording in {folder}/: record one with wingbeat fly, or name a file")
    # A ground station records beside the flight that it watches.
    own = [one for one in flights if not one.name.startswith(GROUND)]
    return max(own or flights, key=lambda one: one.stat().st_mtime_ns)


@contextlib.contextmanager
def reserved(vehicle: str, when: datetime | None = None, folder: Path = RECORDINGS) -> Iterator[Path]:
    """Reserve a new recording path while the context lasts.

    The path has the form ``recordings/robo_raven_ii_d-20261121-131500.mcap``; a repetition within the same second is
    numbered ``-2``, ``-3`` and so on. No file of that name exists, and no other program can reserve it.

    Args:
        vehicle: name, or path of a vehicle file.
        when: local time of the flight (default: now).
        folder: of the recordings; created if missing.

    Raises:
        InputError: the folder cannot be made or written to.
    """
    for path in _free(vehicle, when, folder):
        with locked_name(path) as ours:
            # Checked again: the previous holder of the name may have left files.
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
    """Return the vehicle names of world and flight computer: one name for both, or the two files of a folder."""
    folder = Path(vehicle)
    if folder.is_dir():
        return str(folder / "world.toml"), str(folder / "avionics.toml")
    return vehicle, vehicle
