"""[prepare] of a map: signals that are late put in place, freed of noise and thinned, before maneuvers are cut."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from scipy.signal import detrend

from logs.identification.data.experiment import Experiment, runs
from logs.identification.data.resampling import cut, down_sampled, whole_records
from logs.identification.data.signal_errors import LEAST, shifted, skew_between
from logs.identification.data.smoothing import RATE_SUFFIX, smoothed
from logs.identification.findings import Entry, Finding, register
from logs.identification.results import Array, Estimate, estimate
from logs.identification.sources.table.derived import slope
from logs.identification.sources.table.quantities import SIGNALS
from logs.identification.sources.table.signals import LONGEST_FILL, Record
from wingbeat.errors import InputError
from wingbeat.schema import check_known, read_number, read_record
from wingbeat.text import pluralize

if TYPE_CHECKING:
    from logs.identification.sources.table.maneuvers import DataSplit

LONGEST = 0.5
"""s; largest skew that is tried in both directions"""
LEAST_SMOOTHED = 40
"""-; samples on end that are smoothed"""
LONGEST_GIVEN = 60.0
"""s"""


LINE_RATIO, LINE_SHARE, LINE_POWER, INPUT_POWER = 30.0, 0.8, 0.05, 0.01
"""-; of a vibration: peak over the median spectrum around it; power in the line over that in its neighborhood, and
over that of the output; largest share of the inputs' power in the line"""

register({
    "delay_removed": Entry("{subject}: delay of {value:g} s removed as specified", "[prepare.delay] of the map."),
    "delay_measured": Entry(
        "{slope}{subject} is {value:.4g} s late behind {reference} ({low:.4g} to {high:.4g} s); removed",
        "The cross-correlation of two signals gives the delay.",
    ),
    "smoothed": Entry(
        "{where}: {subject} smoothed by {method}, noise of {value:.3g} {unit} removed{lost}", "[prepare] smooth."
    ),
    "resampled": Entry("{where}: {own:.4g} Hz low-passed and resampled to {value:g} Hz", "[prepare] resample."),
    "stroke_average": Entry(
        "inputs and outputs averaged over one stroke at {value:.3g} Hz",
        "Vibration at the stroke is removed from model and data alike: averaging commutes with a linear model.",
    ),
})  # fmt: skip


class _Reference(NamedTuple):
    reference: str
    by: Annotated[str, "value", "slope"] = "value"
    longest: float = LONGEST


class SignalDelay(NamedTuple):
    """Delay of a signal: given, or by its cross-correlation with a reference."""

    seconds: float | None
    reference: str = ""
    slope: bool = False
    """-; the reference is compared with this signal's derivative"""
    longest: float = LONGEST

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> SignalDelay:
        """Read a map's entry: seconds, or ``{ reference = SIGNAL, by = "value"|"slope", longest = s }``.

        Raises:
            InputError: neither, or a time out of range.
        """
        if isinstance(entry, dict):
            one = read_record(_Reference, entry, key)
            if not 0 < one.longest <= LONGEST_GIVEN:
                raise InputError(f"{key}.longest must be above 0 and at most {LONGEST_GIVEN:g} s")
            return cls(None, one.reference, one.by == "slope", one.longest)
        seconds = read_number(entry, key)
        if abs(seconds) > LONGEST_GIVEN:
            raise InputError(f"{key} = {seconds:g} s is more than {LONGEST_GIVEN:g} s")
        return cls(seconds)


class PrepareSection(NamedTuple):
    """Section [prepare], done in this order."""

    delay: dict[str, SignalDelay] = {}
    """s; by which a signal is late, by its name"""
    smooth: dict[str, Annotated[str, "local_quadratic", "fourier", "spline", "rts", "stroke"]] = {}
    """method by signal; its slope, called NAME_dot, comes with it where it is not measured"""
    resample: float | None = None
    """Hz; after a low-pass against aliasing"""
    stroke_average: float | None = None
    """Hz; flapping frequency: inputs and outputs of [modes] are averaged over one stroke; 0 for never; if not given,
    the frequency of a spectral line that dominates an output"""


class Prepared(NamedTuple):
    """The records, and what was done to them."""

    records: list[Record]
    units: dict[str, str]
    findings: list[Finding]
    delays: tuple[Estimate, ...]
    """s; those that were measured, by the signal's name"""


def prepared(records: list[Record], units: dict[str, str], section: PrepareSection) -> Prepared:
    """The ``records`` with late signals moved, smoothed and resampled as ``section``.

    Raises:
        InputError: a signal that is not there, a skew that is not determined, or a rate above that of a record.
    """
    for key, names in (("delay", section.delay), ("smooth", section.smooth)):
        for name in names:
            check_known(name, units, f"prepare.{key}.{name}")
    experiments = [Experiment(record.file, record.time, record.signals, units) for record in records]
    findings: list[Finding] = []
    measured: list[Estimate] = []
    for name, late in section.delay.items():
        experiments = _moved(experiments, name, late, findings, measured)
    for name, method in section.smooth.items():
        experiments = [_smoothed(one, name, method, findings) for one in experiments]
    if section.resample is not None:
        experiments = [_resampled(one, section.resample, findings) for one in experiments]
    pairs = zip(records, experiments, strict=True)
    whole = {name: unit for one in experiments for name, unit in one.units.items()}
    return Prepared([_record(old, one) for old, one in pairs], whole, findings, tuple(measured))


def _moved(
    experiments: list[Experiment], name: str, late: SignalDelay, findings: list[Finding], measured: list[Estimate]
) -> list[Experiment]:
    if late.seconds is not None:
        findings.append(Finding("delay_removed", "info", name, late.seconds))
        return [shifted(one, (name,), late.seconds) for one in experiments]
    check_known(late.reference, experiments[0].signals, f"prepare.delay.{name}.reference {late.reference}")
    found = _skew(experiments, name, late)
    measured.append(found)
    details = {
        "low": found.low,
        "high": found.high,
        "reference": late.reference,
        "slope": "the slope of " if late.slope else "",
    }
    findings.append(Finding("delay_measured", "info", name, found.value, None, details))
    return [shifted(one, (name,), found.value) for one in experiments]


def _skew(experiments: list[Experiment], name: str, late: SignalDelay) -> Estimate:
    """By how much the signal is late, over all records: their mean, weighted with their errors.

    Raises:
        InputError: no record determines it.
    """
    found: list[Estimate] = []
    reasons: list[str] = []
    for one in experiments:
        for piece in _whole(one, (name, late.reference), 2.0 * late.longest + (LEAST - 1) * one.step):
            own = piece.signals[name]
            own = slope(own, piece.step) if late.slope else own
            skew = skew_between(np.asarray(piece.signals[late.reference]), own, piece.step, late.longest)
            if isinstance(skew, Estimate):
                found.append(skew)
            else:
                reasons.append(skew.text)
    if not found:
        why = reasons[0] if reasons else f"no record has both for {2 * late.longest:g} s on end"
        raise InputError(f"prepare.delay.{name}: its skew behind {late.reference} is not determined: {why}")
    weights = np.array([one.standard_error**-2 for one in found])
    values = np.array([one.value for one in found])
    mean = float(weights @ values / weights.sum())
    scatter = float(weights @ (values - mean) ** 2) / max(len(found) - 1, 1)
    error = float(np.sqrt(max(scatter, 1.0) / weights.sum()))
    return estimate(name, "s", mean, error, len(found) - 1.0 if scatter > 1.0 else np.inf)


def _whole(one: Experiment, names: tuple[str, str], least: float) -> tuple[Experiment, ...]:
    try:
        return whole_records(one, names, LONGEST_FILL * one.step, least)
    except InputError:
        return ()


def _smoothed(one: Experiment, name: str, method: str, findings: list[Finding]) -> Experiment:
    """The signal smoothed run by run between what was not measured, with its slope."""
    values, slope_name = np.asarray(one.signals[name]), name + RATE_SUFFIX
    clean: Array = np.full(len(values), np.nan)
    rates: Array = np.full(len(values), np.nan)
    taken: list[float] = []
    for run in runs(np.isfinite(values)):
        if run.stop - run.start < LEAST_SMOOTHED:
            continue
        done = smoothed(cut(one, run), (name,), method)
        clean[run], rates[run] = done.experiment.signals[name], done.experiment.signals[slope_name]
        taken.append(done.noise[name])
    if not taken:
        raise InputError(f"prepare.smooth.{name}: {one.name} has no {LEAST_SMOOTHED} samples of it on end")
    lost = int(np.isfinite(values).sum() - np.isfinite(clean).sum())
    unit = one.units.get(name, "")
    lost_text = f"; {pluralize(lost, 'sample')} in short pieces left out" if lost else ""
    details = {"where": one.name, "method": method, "unit": unit, "lost": lost_text}
    findings.append(Finding("smoothed", "info", name, max(taken), None, details))
    made = {} if slope_name in one.signals else {slope_name: rates}
    more = {} if slope_name in one.signals else {slope_name: SIGNALS.get(slope_name, f"{unit}/s")}
    return one._replace(signals={**one.signals, name: clean, **made}, units={**one.units, **more})


def _resampled(one: Experiment, rate: float, findings: list[Finding]) -> Experiment:
    own = 1.0 / one.step
    if not 0.0 < rate <= own * (1 + 1e-6):
        raise InputError(f"prepare.resample = {rate:g} Hz is not above 0 and up to the {own:.4g} Hz of {one.name}")
    findings.append(Finding("resampled", "info", "", rate, None, {"where": one.name, "own": own}))
    return down_sampled(one, max(1.0 / rate, one.step))


def _record(old: Record, one: Experiment) -> Record:
    """The prepared experiment as a record of the same table."""
    at = np.clip(np.searchsorted(old.time, one.time + 1e-9, side="right") - 1, 0, None)
    marks = None if old.marks is None else old.marks[at]
    return Record(old.file, one.time, old.rows[at], dict(one.signals), marks)


def stroke_averaged(
    data: DataSplit, inputs: Sequence[str], outputs: Sequence[str], frequency: float | None
) -> DataSplit:
    """The maneuvers with every signal averaged over one period of ``frequency`` (Hz); unchanged for 0.

    None takes the frequency of a vibration that dominates an output, if there is one.
    """
    if frequency is None:
        frequency = vibration_frequency(data.fitted, inputs, outputs)
    if not frequency or 1.0 / frequency < 2.0 * max(one.step for one in data.all):
        return data
    averaged = data.map(lambda one: _averaged(one, 1.0 / frequency))
    finding = Finding("stroke_average", "info", "", frequency)
    return averaged._replace(averaged=True, findings=(*data.findings, finding))


def vibration_frequency(experiments: Sequence[Experiment], inputs: Sequence[str], outputs: Sequence[str]) -> float:
    """Frequency (Hz) of the lowest spectral line that dominates an output and is not in the inputs; 0 without one."""
    one = max(experiments, key=lambda each: len(each.time))
    found = [line for name in outputs if (line := _line(one, name)) is not None]
    spectra = [_periodogram(one, name) for name in inputs]
    for frequency in sorted(found):
        driven = False
        for axis, power in (spectrum for spectrum in spectra if spectrum is not None):
            near = np.abs(axis - frequency) <= 2.0 * (axis[1] - axis[0])
            driven |= float(power[near].sum()) > INPUT_POWER * float(power.sum())
        if not driven:
            return frequency
    return 0.0


def _periodogram(one: Experiment, name: str) -> tuple[Array, Array] | None:
    values = np.asarray(one.signals.get(name, np.zeros(0)), dtype=np.float64)
    known = np.isfinite(values)
    if len(values) < 4 * LEAST_SMOOTHED or known.mean() < 0.9 or not np.ptp(values[known]) > 0.0:
        return None
    whole = detrend(np.interp(one.time, one.time[known], values[known])) * np.hanning(len(values))
    return np.asarray(np.fft.rfftfreq(len(values), one.step)), np.asarray(np.abs(np.fft.rfft(whole)) ** 2)


def _line(one: Experiment, name: str) -> float | None:
    """Frequency of a narrow line above the motion, of constant amplitude over the record."""
    spectrum = _periodogram(one, name)
    if spectrum is None:
        return None
    axis, power = spectrum
    lowest = 8  # periods in the record: below it a line and a slow motion look the same
    peak = lowest + int(np.argmax(power[lowest:-3]))
    line = slice(peak - 2, peak + 3)
    around = np.concatenate((power[max(peak - 24, lowest) : peak - 3], power[peak + 4 : peak + 25]))
    if not len(around) or float(power[peak]) < LINE_RATIO * float(np.median(around)):
        return None
    size = float(power[line].sum())
    if size < LINE_SHARE * (size + float(around.sum())) or size < LINE_POWER * float(power.sum()):
        return None
    half = len(one.time) // 2
    turn = np.exp(-2j * np.pi * axis[peak] * one.time)
    values = np.nan_to_num(np.asarray(one.signals[name]) - np.nanmean(one.signals[name]))
    first, second = (abs(np.mean(values[part] * turn[part])) for part in (slice(0, half), slice(half, None)))
    if not 0.5 < first / max(second, 1e-300) < 2.0:
        return None
    left, middle, right = np.log(power[peak - 1 : peak + 2])
    return float(axis[peak] + 0.5 * (left - right) / (left - 2.0 * middle + right) * (axis[1] - axis[0]))


def _averaged(one: Experiment, period: float) -> Experiment:
    """Every signal averaged over ``period`` s about each sample, lines between samples; the ends are left out."""
    half = period / one.step / 2.0
    places = np.arange(-np.ceil(half) - 1.0, np.ceil(half) + 2.0)

    def integral(x: Array) -> Array:
        """Of the hat function, up to ``x``."""
        x = np.clip(x, -1.0, 1.0)
        return np.asarray(np.where(x < 0.0, 0.5 * (1.0 + x) ** 2, 1.0 - 0.5 * (1.0 - x) ** 2))

    weights = (integral(half - places) - integral(-half - places)) / (2.0 * half)
    margin = len(places) // 2
    signals = {
        name: np.convolve(np.asarray(values, dtype=np.float64), weights[::-1], mode="valid")
        for name, values in one.signals.items()
    }
    return one._replace(time=one.time[margin : len(one.time) - margin], signals=signals)
