"""Logs of other programs: checks and import."""

from __future__ import annotations

from pathlib import Path

from logs.checks.run import LogReport
from logs.checks.run import check_log as check_paths
from logs.importing.log_import import Choice
from logs.importing.log_import import import_log as convert
from logs.importing.wing import WingSource
from logs.reader import Log, open_log
from wingbeat.api.flights import Flight

__all__ = ["LogReport", "check_log", "import_log"]


def check_log(*files: Path | str | Flight | Log, map: Path | str | None = None) -> LogReport:
    """Find faults of a log: clocks, sensors, drive, battery, content.

    Args:
        files: one flight or log (.mcap, .ulg, .bin, .tlog, .csv), or several tables with a common clock.
        map: columns of a table, see ``wingbeat log import --help``.

    Returns:
        the findings with code, severity, topic, time and value; ``.to_pandas()`` gives a table.

    Raises:
        InputError: a file cannot be read, or has no data.
    """
    paths = [file.path if isinstance(file, Flight | Log) else Path(file) for file in files]
    return check_paths(paths, None if map is None else Path(map))


def import_log(
    file: Path | str,
    to: Path | str | None = None,
    *,
    map: Path | str | None = None,
    wing: str = "",
    counts: float = 0.0,
    gear: float = 1.0,
) -> Log:
    """Convert a log of another program and open it; its first boot if there are several.

    Args:
        file: .ulg, .bin, .tlog, .c3d, or a table.
        to: new MCAP file (default: FILE with extension .mcap).
        map: columns of a table.
        wing: topic with the wing's counts, speed, frequency or phase (default: what there is).
        counts: encoder counts per turn.
        gear: encoder turns or pulses per stroke.

    Raises:
        InputError: the file cannot be read or has an unknown format, or the new log exists.
    """
    source = Path(file)
    target = source.with_suffix(".mcap") if to is None else Path(to)
    choice = Choice(source, target, None if map is None else Path(map), wing=WingSource(wing, counts, gear))
    convert(choice)
    return open_log(target)
