"""Page of a vibration analysis: spectra, harmonics, level by stroke phase, advice."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from logs.pages.document import MEASURED, MODEL, OTHER, STEMS, Cell, Chapter, Plot, Remark, Series, Table
from logs.pages.render import write_page
from logs.vibration.analysis import AXES, PHASE_BINS, UNITS, Array, Spectrum
from logs.vibration.fit import VibrationFit, modeled_density
from logs.vibration.flight import FlightVibration


def write(path: Path, name: str, vibration: FlightVibration, fit: VibrationFit | None) -> int:
    """Write the page to ``path``, which must not exist; return its size in bytes.

    Args:
        path: of the page.
        name: of the log.
        vibration: result.
        fit: of a vehicle; None without one.

    Raises:
        InputError: the file exists or cannot be written.
    """
    spectrum = vibration.spectrum
    facts = (
        f"{vibration.start:.1f} to {vibration.end:.1f} s",
        f"{spectrum.strokes:.0f} strokes at {spectrum.stroke_frequency:.3f} Hz",
        f"samples at {spectrum.rate:.1f} Hz",
    )
    chapters = (_levels(vibration), _spectra(spectrum, fit), _phases(spectrum))
    return write_page(path, f"Vibration of {name}", facts, chapters)


def _levels(vibration: FlightVibration) -> Chapter:
    spectrum = vibration.spectrum
    heads = ("axis", "unit", *(f"{low:.0f} to {high:.0f} Hz" for low, high in spectrum.bands), "> 40 Hz", "quiet")
    rows: list[tuple[Cell, ...]] = []
    for i, name in enumerate(AXES):
        levels = (*spectrum.band_rms[:, i].tolist(), float(spectrum.broadband[i]), float(vibration.quiet[i]))
        rows.append((name, UNITS[i], *levels))
    table = Table(heads, tuple(rows), "RMS by band, without the stroke harmonics below 20 Hz.")
    amplitudes: list[tuple[Cell, ...]] = [(str(k + 1), *row.tolist()) for k, row in enumerate(spectrum.harmonics)]
    harmonics = Table(("harmonic", *AXES), tuple(amplitudes), "Amplitude of the stroke's harmonics.")
    findings = tuple(Remark(one.severity, one.code, one.text) for one in vibration.advice)
    notes = (f"quiet: the two seconds from {vibration.quiet_start:.1f} s on",)
    return Chapter("Levels", notes, (table, harmonics), findings=findings)


def _spectra(spectrum: Spectrum, fit: VibrationFit | None) -> Chapter:
    modeled = None if fit is None else modeled_density(fit, spectrum)
    plots = []
    for i, name in enumerate(AXES):
        series = [Series("measured", spectrum.frequency, _decibel(spectrum.density[:, i]), MEASURED)]
        if modeled is not None:
            series.append(Series("fitted modes", spectrum.frequency, _decibel(modeled[:, i]), MODEL))
        unit = f"dB re ({UNITS[i]})^2/Hz"
        plots.append(Plot(name, "frequency", "Hz", "power spectral density", unit, tuple(series)))
    return Chapter("Spectra", plots=tuple(plots))


def _phases(spectrum: Spectrum) -> Chapter:
    phase = (np.arange(PHASE_BINS) + 0.5) / PHASE_BINS
    plots = tuple(
        Plot(name, "stroke phase", "-", "RMS above 40 Hz", UNITS[i], (
            Series("", phase, spectrum.by_phase[:, i], OTHER, STEMS),
        ))
        for i, name in enumerate(AXES)
    )  # fmt: skip
    note = "Phase 0 is the largest upward force, in the middle of the downstroke."
    return Chapter("Level by stroke phase", (note,), plots=plots)


def _decibel(density: Array) -> Array:
    decibel: Array = 10.0 * np.log10(np.maximum(density, 1e-12))
    return decibel
