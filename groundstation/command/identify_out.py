"""``wingbeat identify --report`` and ``--model``: output files."""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from avionics import topics
from avionics.vehicles import load_vehicle as load_flight_vehicle
from groundstation.command import options
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from logs.attached import flight_vehicle, simulated_vehicle
from logs.identification.data.flight import DriveData
from logs.identification.report import Identification, model_file
from logs.identification.report.report import Subject, write_report
from logs.identification.sources.flight import drive_data
from logs.info import vehicle as vehicle_name
from logs.pages.render import refuse_existing
from logs.reader import Log
from sim_bridge.vehicles import load_vehicle as load_world
from wingbeat.errors import InputError

BLOCK = 1 << 20
"""bytes read at once"""


def add_outputs(parser: argparse.ArgumentParser) -> None:
    """Add ``--report`` and ``--model``."""
    parser.add_argument(
        "--report", type=Path, metavar="OUT.html", help="write a page: data, model, intervals, fits, residuals, modes"
    )
    parser.add_argument(
        "--model",
        type=Path,
        metavar="OUT.toml",
        help="write a linear model for wingbeat tune, and the folder OUT/ for wingbeat fly --vehicle OUT",
    )


def check_outputs(chosen: argparse.Namespace) -> None:
    """Reject existing output files before the computation.

    Raises:
        InputError: one exists, or the model requires modes that are not identified.
    """
    if chosen.report is not None:
        refuse_existing(chosen.report)
    if chosen.model is not None:
        model_file.places(chosen.model)


def write_outputs(
    logs: Sequence[Log],
    estimates: Identification,
    report: Path | None,
    model: Path | None = None,
    vehicle: str | None = None,
) -> list[str]:
    """Write the requested files; return lines about them and about parameters that are not identified.

    ``logs`` are the fitted ones, of one aircraft, followed by those for validation. ``vehicle`` is the base of the
    model if the log has none.

    Raises:
        InputError: a file exists or cannot be written, or there is no model to write.
    """
    lines: list[str] = []
    if report is None and model is None:
        return lines
    digests = [sha256(log.path) for log in logs]
    if report is not None:
        with ProgressBar("writing the report"):
            write_report(report, _subject(logs, digests), estimates, _drive(logs[0], estimates))
        lines.append(f"written {report}")
    if model is not None:
        lines += _model(model, vehicle, logs, estimates, digests)
    return lines


def show_written(lines: Sequence[str], as_json: bool) -> None:
    """Print the names of the written files below the table, but not with a JSON document."""
    if not as_json:
        for line in lines:
            open_console().print(line, soft_wrap=True)


def show_next_steps(chosen: argparse.Namespace, has_modes: bool) -> None:
    """Print what can be done with the result, but not with a JSON document."""
    if chosen.json:
        return
    steps = [] if chosen.report is not None else ["--report OUT.html writes plots of fits and residuals"]
    if has_modes and chosen.model is None:
        steps.append("--model OUT.toml writes a model for wingbeat tune OUT.toml")
    steps.append("wingbeat design plans inputs that narrow the intervals")
    console = open_console()
    console.print()
    for number, step in enumerate(steps):
        console.print(f"{'next: ' if number == 0 else '      '}{step}", style="dim", soft_wrap=True)


def sha256(path: Path) -> str:
    """Compute the SHA-256 of a file in hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            digest.update(block)
    return digest.hexdigest()


def names_of(logs: Sequence[Log]) -> tuple[str, ...]:
    """Return the names of the logs by their files, with the folder if two are equal."""
    short = [log.path.name for log in logs]
    return tuple(name if short.count(name) == 1 else str(log.path) for name, log in zip(short, logs, strict=True))


def _subject(logs: Sequence[Log], digests: Sequence[str]) -> Subject:
    """Return the subject: first log with its digest and facts, the other logs, and the total length."""
    log, names = logs[0], names_of(logs)
    name = vehicle_name(log) or "unknown vehicle"
    begun = datetime.fromtimestamp(log.start_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M UTC")
    length = sum((one.end_ns - one.start_ns) * 1e-9 for one in logs)
    world = simulated_vehicle(log)
    flown = "a real flight, or another simulator" if world is None else f"simulated, {world.aerodynamics.model}"
    facts = (("vehicle", name), ("recorded", begun), ("length", f"{length:.1f} s"), ("flight", flown))
    damage = tuple(("damage", line) for one in logs for line in one.damage)
    more = tuple(zip(names, digests, strict=True))[1:]
    return Subject(f"{name}: identification", names[0], digests[0], (*facts, *damage), more)


def _drive(log: Log, estimates: Identification) -> DriveData | None:
    return drive_data(log) if estimates.torque is not None or estimates.power is not None else None


def _model(
    path: Path, vehicle: str | None, logs: Sequence[Log], estimates: Identification, digests: Sequence[str]
) -> list[str]:
    if estimates.modes is None:
        why = "; ".join(one.text for one in estimates.missing)
        raise InputError(f"--model {path}: no modes were identified{why and f': {why}'}")
    locked_name = {one.flight.name for one in estimates.modes.held_out if one.flight is not None}
    fitted = [
        (one, name, sum_)
        for one, name, sum_ in zip(logs, names_of(logs), digests, strict=True)
        if name not in locked_name
    ]
    densities = [density for one, _, _ in fitted if (density := _density(one)) is not None]
    log, names, sums = fitted[0][0], (name for _, name, _ in fitted), (sum_ for _, _, sum_ in fitted)
    about = model_file.Log(" ".join(names), " ".join(sums), float(np.mean(densities)) if densities else None)
    with ProgressBar("linearising what was not identified") as bar:
        written = model_file.write_model(path, estimates.modes, about, _base(vehicle, log), bar.show)
    return [f"written {' and '.join(str(path) for path in written.paths)}", *written.notes]


def _density(log: Log) -> float | None:
    """Return the mean air density in kg/m^3, None without air data."""
    if topics.AIR_DATA.name not in log.topics:
        return None
    told = np.asarray(log.columns(topics.AIR_DATA)["density"], dtype=np.float64)
    told = told[np.isfinite(told) & (told > 0.0)]
    return float(told.mean()) if len(told) else None


def _base(vehicle: str | None, log: Log) -> model_file.Base | None:
    """Return the vehicle of the log's own files, else of ``--vehicle``; None without bodies."""
    if vehicle is not None:
        return base_of(vehicle)
    world_of_log = simulated_vehicle(log)
    return None if world_of_log is None else model_file.Base(world_of_log, flight_vehicle(log))


def base_of(vehicle: str) -> model_file.Base:
    """Return the vehicle by name or file."""
    world, avionics = options.vehicle_files(vehicle)
    return model_file.Base(load_world(world), load_flight_vehicle(avionics))
