"""Recorded wing angles: a CSV table of samples, or a TOML file of Fourier coefficients.

Columns of a table: ``time`` (s) or ``phase`` (strokes, 0 to 1), then ``WING.ANGLE`` with the angles of
`ANGLES`, in rad or with the suffix ``_deg``; ``WING.`` is omitted for the only wing. ``lift`` and ``thrust`` (N) are
measured forces. A stroke is represented by Fourier series fitted by least squares; a record of time without a
frequency by a cubic spline.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from sim_bridge.flight_mechanics.prescribed import Harmonics, JointAngles, series
from sim_bridge.vectors import Floats
from wingbeat.documents import parse_toml
from wingbeat.errors import DocumentError, InputError
from wingbeat.schema import error_context, read_record
from wingbeat.text import did_you_mean, read_error_text
from wingbeat.units import Quantity

ANGLES = JointAngles._fields
"""stroke, deviation, feathering, twist; see `sim_bridge.flight_mechanics.prescribed`"""
FORCES = ("lift", "thrust")
"""measured forces, N: vertical up and horizontal forward"""
PHASES = 200
"""steps of a stroke"""
HARMONICS = 8
"""greatest default number of harmonics; at most a quarter of the samples"""
FEWEST = 8
"""rows of a table"""
DEGREES = "_deg"
LARGEST = math.pi
"""rad; greatest peak-to-peak angle of a wing"""
UNEXPLAINED = 0.25
"""share of a stroke angle's variance that its harmonics leave at most"""


class RecordedMotion(NamedTuple):
    """Motion of all wings at N equal steps."""

    time: Floats
    """(N,) s"""
    period: float
    """s; of the N steps"""
    stroke_rate: float
    """Hz; flapping frequency, estimated by the mean stroke rate if none is given"""
    periodic: bool
    """whether the motion repeats itself"""
    angles: dict[str, JointAngles]
    """by wing"""
    measured: dict[str, Floats]
    """N; measured forces (M,) by name of `FORCES`"""
    measured_time: Floats
    """(M,) s"""
    source: str
    """path"""


Coefficients = Annotated[tuple[float, ...], Quantity("rad", -6.3, 6.3)]


class WingSeries(NamedTuple):
    """Table ``[motion.NAME]`` of a TOML file: mean, then cosine and sine of each harmonic."""

    stroke: Coefficients
    deviation: Coefficients = ()
    feathering: Coefficients = ()
    twist: Coefficients = ()


class MeasuredMeans(NamedTuple):
    """Table ``[measured]``: mean forces."""

    lift: Annotated[float, Quantity("N", -1e6, 1e6)] = math.nan
    thrust: Annotated[float, Quantity("N", -1e6, 1e6)] = math.nan


class FourierMotion(NamedTuple):
    """TOML file of Fourier coefficients."""

    frequency: Annotated[float, Quantity("Hz", 1e-3, 1e4)]
    motion: dict[str, WingSeries]
    measured: MeasuredMeans = MeasuredMeans()


def load_motion(
    path: Path, wings: Sequence[str], frequency: float | None = None, harmonics: int | None = None
) -> RecordedMotion:
    """Read recorded wing angles; ``wings`` are the names of the wings that they move.

    Args:
        path: a table (.csv) or a file of Fourier coefficients (.toml).
        wings: names.
        frequency: Hz; a table's flapping frequency. A record of time without one is not taken as periodic.
        harmonics: number of harmonics fitted to a table.

    Raises:
        InputError: unreadable file, unknown or missing column, too few samples, or time that does not increase.
    """
    if path.suffix == ".toml":
        if frequency is not None or harmonics is not None:
            raise InputError(f"{path} states frequency and harmonics itself")
        return _fourier_motion(path)
    with error_context(path):
        return _table_motion(path, wings, frequency, harmonics)


def _fourier_motion(path: Path) -> RecordedMotion:
    try:
        document = parse_toml(path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read motion {path}: {read_error_text(error)}") from None
    except DocumentError as error:
        raise InputError(f"{path}: {error}") from None
    with error_context(path):
        read = read_record(FourierMotion, document)
        if not read.motion:
            raise InputError("no wing: a table [motion.NAME] is missing")
    phases = np.arange(PHASES) / PHASES
    angles = {
        name: JointAngles(*(series(harmonics_of(values), phases, read.frequency) for values in wing))
        for name, wing in read.motion.items()
    }
    measured = {name: np.array([value]) for name, value in read.measured._asdict().items() if not math.isnan(value)}
    period = 1.0 / read.frequency
    return RecordedMotion(
        phases * period, period, read.frequency, True, angles, measured, np.array([0.5 * period]), str(path)
    )


def harmonics_of(coefficients: Sequence[float]) -> Harmonics:
    """Convert mean, then cosine and sine of each harmonic."""
    mean, rest = (coefficients[0], tuple(coefficients[1:])) if coefficients else (0.0, ())
    return Harmonics(mean, rest[0::2], rest[1::2])


def read_columns(path: Path) -> dict[str, Floats]:
    """Read a CSV table with a header line of names.

    Raises:
        InputError: unreadable, no header, a row of another length, or a cell that is no finite number.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            numbered = [(reader.line_num, row) for row in reader if row and not row[0].lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = str(error) if isinstance(error, csv.Error) else read_error_text(error)
        raise InputError(f"cannot read the table: {reason}") from None
    if len(numbered) <= FEWEST:
        raise InputError(
            f"{max(len(numbered) - 1, 0)} rows: at least {FEWEST} are needed below the names of the columns"
        )
    names = [name.strip() for name in numbered[0][1]]
    twice = next((name for n, name in enumerate(names) if name in names[:n]), None)
    if twice is not None:
        raise InputError(f"two columns are called {twice!r}")
    values = np.zeros((len(numbered) - 1, len(names)))
    for number, (line, row) in enumerate(numbered[1:]):
        if len(row) != len(names):
            raise InputError(f"row {line} has {len(row)} cells, the header has {len(names)}")
        for column, cell in enumerate(row):
            try:
                values[number, column] = float(cell)
            except ValueError:
                raise InputError(f"row {line}, {names[column]}: {cell.strip()!r} is not a number") from None
    if not np.isfinite(values).all():
        raise InputError("a cell is not finite")
    return dict(zip(names, values.T, strict=True))


def _table_motion(path: Path, wings: Sequence[str], frequency: float | None, harmonics: int | None) -> RecordedMotion:
    table = read_columns(path)
    clock = [name for name in ("time", "phase") if name in table]
    if len(clock) != 1:
        raise InputError("needs one column time (s) or phase (strokes)")
    at = table.pop(clock[0])
    if np.any(np.diff(at) <= 0.0):
        raise InputError(f"{clock[0]} does not increase from row to row")
    measured = {name: table.pop(name) for name in FORCES if name in table}
    samples = _samples(table, wings)
    if frequency is None:
        if clock[0] == "phase":
            raise InputError("a table of phase needs the flapping frequency (--frequency)")
        if harmonics is not None:
            raise InputError("harmonics are fitted to a stroke: they need the flapping frequency (--frequency)")
        return _record(at, samples, measured, str(path))
    phase = at if clock[0] == "phase" else (at - at[0]) * frequency
    count = harmonics or max(min(HARMONICS, len(at) // 4), 1)
    if 2 * count + 1 > len(at):
        raise InputError(f"{len(at)} samples do not give {count} harmonics")
    if phase[-1] - phase[0] < 0.8:
        raise InputError(f"{phase[-1] - phase[0]:.2g} strokes at {frequency:g} Hz: a whole stroke is needed")
    steps = np.arange(PHASES) / PHASES
    fitted = {wing: {name: _fitted(phase, own.get(name), count) for name in ANGLES} for wing, own in samples.items()}
    for wing, own in samples.items():
        _check_repetition(wing, own["stroke"], _at(fitted[wing]["stroke"], phase), frequency)
    angles = {
        wing: JointAngles(*(series(own[name], steps, frequency) for name in ANGLES)) for wing, own in fitted.items()
    }
    period = 1.0 / frequency
    measured_phase, measured = _folded(phase, measured)
    return RecordedMotion(
        steps * period, period, frequency, True, angles, measured, measured_phase * period, str(path)
    )


def _folded(phase: Floats, measured: dict[str, Floats]) -> tuple[Floats, dict[str, Floats]]:
    """Return the measured forces of whole strokes over the phase of one, from 0 to 1."""
    strokes = max(np.floor(phase[-1] - phase[0] + 1e-9), 1.0)
    whole = phase - phase[0] < strokes
    within = phase[whole] % 1.0
    order = np.argsort(within, kind="stable")
    return within[order], {name: values[whole][order] for name, values in measured.items()}


def _samples(table: dict[str, Floats], wings: Sequence[str]) -> dict[str, dict[str, Floats]]:
    """Return the angles in rad by wing and name."""
    samples: dict[str, dict[str, Floats]] = {}
    known = [f"{wing}.{angle}" for wing in wings for angle in ANGLES]
    for column, values in table.items():
        degrees = column.endswith(DEGREES)
        wing, _, angle = column.removesuffix(DEGREES).rpartition(".")
        wing = wing or (wings[0] if len(wings) == 1 else "")
        if wing not in wings or angle not in ANGLES:
            told = did_you_mean(column, known)
            raise InputError(f"unknown column {column!r}{told}; known: {', '.join(known)}, {', '.join(FORCES)}")
        if angle in samples.setdefault(wing, {}):
            raise InputError(f"{wing}.{angle} is in two columns")
        moved = np.radians(values) if degrees else values
        if np.ptp(moved) > LARGEST:
            why = "more than half a turn" if degrees else f"in degrees the column is {column}{DEGREES}"
            raise InputError(f"{column} moves through {np.ptp(moved):.3g} rad: {why}")
        samples[wing][angle] = moved
    without = [wing for wing in wings if "stroke" not in samples.get(wing, {})]
    if without:
        raise InputError(f"no column {without[0]}.stroke")
    return samples


def _fitted(phase: Floats, values: Floats | None, count: int) -> Harmonics:
    """Fit a Fourier series by least squares."""
    if values is None:
        return Harmonics()
    angle = 2.0 * math.pi * phase[:, None] * np.arange(1, count + 1)
    basis = np.concatenate((np.ones((len(phase), 1)), np.cos(angle), np.sin(angle)), axis=1)
    found = np.linalg.lstsq(basis, values, rcond=None)[0].tolist()
    return Harmonics(found[0], tuple(found[1 : count + 1]), tuple(found[count + 1 :]))


def _at(fitted: Harmonics, phase: Floats) -> Floats:
    """Return the series (N,) at phases in strokes."""
    angle = 2.0 * math.pi * phase[:, None] * np.arange(1, len(fitted.cosine) + 1)
    values: Floats = fitted.mean + np.cos(angle) @ np.array(fitted.cosine) + np.sin(angle) @ np.array(fitted.sine)
    return values


def _check_repetition(wing: str, stroke: Floats, series_: Floats, frequency: float) -> None:
    """Reject a flapping frequency that is not that of the samples.

    Raises:
        InputError: the harmonics leave more than a quarter of the variance.
    """
    share = float(np.mean((stroke - series_) ** 2)) / max(float(np.var(stroke)), 1e-12)
    if share > UNEXPLAINED:
        raise InputError(
            f"{wing}.stroke does not repeat itself at {frequency:g} Hz: its harmonics leave {100.0 * share:.0f} % "
            "of the variance; is --frequency right?"
        )


def _record(
    time: Floats, samples: dict[str, dict[str, Floats]], measured: dict[str, Floats], source: str
) -> RecordedMotion:
    """Resample a record by cubic splines at as many equal steps as it has samples."""
    from scipy.interpolate import CubicSpline  # takes 0.2 s

    count = len(time)
    period = float(time[-1] - time[0]) * count / (count - 1)
    steps = time[0] + np.arange(count) * period / count

    def sampled(values: Floats | None) -> Floats:
        if values is None:
            return np.zeros((3, count))
        spline: Any = CubicSpline(time, values)
        return np.array([spline(steps, order) for order in range(3)])

    angles = {wing: JointAngles(*(sampled(own.get(name)) for name in ANGLES)) for wing, own in samples.items()}
    # A stroke of peak-to-peak angle Phi at f Hz has the mean rate 2 Phi f.
    rates = [
        float(np.mean(np.abs(one.stroke[1]))) / max(2.0 * float(np.ptp(one.stroke[0])), 1e-9)
        for one in angles.values()
    ]
    return RecordedMotion(steps - steps[0], period, max(rates), False, angles, measured, time - time[0], source)
