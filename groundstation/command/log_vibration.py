"""``wingbeat log vibration``: vibration at the IMU, and the vibration section of a vehicle."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from groundstation.command import options
from groundstation.views import tables
from groundstation.views.json_document import print_document
from groundstation.views.terminal import open_console
from logs.new_files import check_new
from logs.reader import open_log
from wingbeat.errors import InputError
from wingbeat.vehicle_file import name_by_path

if TYPE_CHECKING:
    from logs.vibration.fit import VibrationFit
    from logs.vibration.flight import FlightVibration

SUMMARY = (
    "Analyze the vibration at the IMU: harmonics of the stroke, broadband level, level by stroke phase, clipping,"
    " advice. With --fit write a copy of a vehicle whose structural modes and impacts have this spectrum."
)
WORLD, AVIONICS = "world.toml", "avionics.toml"


def add_verb(verbs: Any) -> None:
    """Add ``vibration``."""
    one = verbs.add_parser(
        "vibration", help="spectrum at the IMU, and a vehicle that vibrates so", description=SUMMARY
    )
    one.add_argument(
        "file", type=options.recording_file, metavar="FILE", help="path, or latest: the newest of recordings/"
    )
    one.add_argument("--start", type=options.number, metavar="S", help="from so many seconds since boot on")
    one.add_argument("--end", type=options.number, metavar="S", help="to so many seconds since boot")
    one.add_argument("--fit", metavar="VEHICLE", help="fit the vibration section of this vehicle")
    one.add_argument("--out", type=Path, metavar="DIR", help="new folder for the vehicle, with --fit")
    one.add_argument("--report", type=Path, metavar="OUT.html", help="write a page with spectra and levels")
    options.add_json(one)


def run_verb(chosen: argparse.Namespace) -> None:
    """Analyze, print and, if requested, write the vehicle.

    Raises:
        InputError: no IMU or no strokes in the log, an unknown vehicle, or an output that exists.
    """
    from logs.vibration.flight import flight_vibration

    if (chosen.fit is None) != (chosen.out is None):
        raise InputError("--fit VEHICLE and --out DIR belong together")
    if chosen.report is not None:
        check_new(chosen.report)
    if chosen.out is not None:
        for name in (WORLD, AVIONICS):
            check_new(chosen.out / name, made=True)
    with open_log(chosen.file) as log:
        vibration = flight_vibration(log, chosen.start, chosen.end)
    fitted, files = None, []
    if chosen.fit is not None:
        fitted = _fitted(chosen.fit, vibration)
        files = _write(chosen, fitted)
    if chosen.report is not None:
        from logs.vibration.page import write

        write(chosen.report, chosen.file.name, vibration, fitted)
    if chosen.json:
        print_document(_document(chosen, vibration, fitted, files))
    else:
        _print(vibration, fitted, files)
        if chosen.report is not None:
            print(f"written {chosen.report}")


def _fitted(name: str, vibration: FlightVibration) -> VibrationFit:
    """Fit the modes of a vehicle, whose drive and sensors are those of its file."""
    from logs.vibration.fit import fit
    from logs.vibration.vehicle_file import FITTED
    from sim_bridge.vehicles import load_vehicle

    vehicle = load_vehicle(options.vehicle_files(name)[0])
    rate = vibration.flap_rate
    if math.isnan(rate):  # of a sine with the stroke of the vehicle's cruise
        drive = vehicle.drive
        amplitude = vehicle.cruise.stroke_amplitude if drive.kind == "servo" else drive.crank_amplitude
        rate = math.tau * vibration.spectrum.stroke_frequency * amplitude / math.sqrt(2.0)
    bandwidths = vehicle.sections["gyroscope"].bandwidth, vehicle.sections["accelerometer"].bandwidth
    own = vehicle.sections.get("vibration")
    if own is None:
        return fit(vibration.spectrum, rate, bandwidths)
    airspeed = vehicle.cruise.airspeed if math.isnan(vibration.airspeed) else vibration.airspeed
    fitted = fit(vibration.spectrum, rate, bandwidths, own.airspeed_buffet * airspeed**2)
    # The spectrum tells nothing of the mount, the magnetometer and the wings: the vehicle keeps its own values.
    spec = own._replace(**{name: getattr(fitted.spec, name) for name in FITTED})
    return fitted._replace(spec=spec)


def _write(chosen: argparse.Namespace, fitted: VibrationFit) -> list[Path]:
    from avionics.vehicles import load_vehicle as load_flight_vehicle
    from logs.vibration.vehicle_file import with_name, with_vibration
    from sim_bridge.vehicles import load_vehicle

    world, computer = options.vehicle_files(chosen.fit)
    source = f"identified: wingbeat log vibration, {chosen.file.name}"
    text = with_vibration(load_vehicle(world).text, fitted, source)
    chosen.out.mkdir(parents=True, exist_ok=True)
    written = []
    for name, content in ((WORLD, text), (AVIONICS, load_flight_vehicle(computer).file.text)):
        path = chosen.out / name
        path.write_text(with_name(content, name_by_path(path)), encoding="utf-8")
        written.append(path)
    return written


def _document(
    chosen: argparse.Namespace, vibration: FlightVibration, fitted: VibrationFit | None, files: list[Path]
) -> dict[str, Any]:
    from logs.vibration.analysis import AXES, UNITS

    spectrum = vibration.spectrum
    axes = {
        name: {
            "unit": UNITS[i],
            "harmonics": spectrum.harmonics[:, i].tolist(),
            "bands": spectrum.band_rms[:, i].tolist(),
            "broadband": float(spectrum.broadband[i]),
            "quiet": float(vibration.quiet[i]),
            "by_phase": spectrum.by_phase[:, i].tolist(),
            "density": spectrum.density[:, i].tolist(),
        }
        for i, name in enumerate(AXES)
    }
    return {
        "file": str(chosen.file),
        "start": vibration.start,
        "end": vibration.end,
        "rate": spectrum.rate,
        "strokes": spectrum.strokes,
        "stroke_frequency": spectrum.stroke_frequency,
        "ringing": spectrum.ringing,
        "clipped": spectrum.clipped.tolist(),
        "bands": [list(band) for band in spectrum.bands],
        "frequency": spectrum.frequency.tolist(),
        "axes": axes,
        "quiet_start": vibration.quiet_start,
        "advice": [one._asdict() for one in vibration.advice],
        "fit": None if fitted is None else {"vibration": fitted.spec, "modes": fitted.modes},
        "files": [str(path) for path in files],
    }


def _print(vibration: FlightVibration, fitted: VibrationFit | None, files: list[Path]) -> None:
    from logs.vibration.analysis import AXES, UNITS, broadband_corner

    spectrum, console = vibration.spectrum, open_console()
    console.print(
        f"{vibration.start:.1f} to {vibration.end:.1f} s: {spectrum.strokes:.0f} strokes at "
        f"{spectrum.stroke_frequency:.3f} Hz, samples at {spectrum.rate:.1f} Hz"
    )
    bands = [f"{low:.0f}-{high:.0f} Hz" for low, high in spectrum.bands if low >= 20.0]
    headings = ("stroke", "2nd", *bands, f"> {broadband_corner(1.0 / spectrum.rate):.0f} Hz", "quiet")
    table = tables.plain_table(("RMS", ""), *((name, "right") for name in headings), ("", "unit"))
    first = len(spectrum.bands) - len(bands)
    for i, name in enumerate(AXES):
        values = (
            *spectrum.harmonics[:2, i] / math.sqrt(2.0), *spectrum.band_rms[first:, i], spectrum.broadband[i],
            vibration.quiet[i],
        )  # fmt: skip
        table.add_row(name, *(f"{value:.3g}" for value in values), UNITS[i])
    console.print(table)
    line = "ringing after impacts" if spectrum.impacts else "no impacts, strongest line"
    console.print(f"quiet: {vibration.quiet_start:.1f} s   {line} at {spectrum.ringing:.0f} Hz")
    for one in vibration.advice:
        console.print(f"{one.severity}: {one.text} ({one.code})", style="yellow" if one.severity == "warning" else "")
    if fitted is not None:
        console.print(f"{len(fitted.modes)} modes fitted; written {', '.join(map(str, files))}", soft_wrap=True)
        command = f"wingbeat fly --vehicle {files[0].parent}"
        console.print(f"next: {command}", style="dim", soft_wrap=True)
