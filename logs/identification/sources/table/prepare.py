"""[prepare] of a map: signals that are late put in place, freed of noise and thinned, before manoeuvres are cut."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from logs.identification.data.contiguous_runs import runs
from logs.identification.data.experiment import Experiment
from logs.identification.data.resampling import cut, down_sampled, whole_records
from logs.identification.data.smoothing import RATE_SUFFIX, smoothed
from logs.identification.data.time_skew import LEAST, shifted, skew_between
from logs.identification.results import Array, Estimate, estimate
from logs.identification.sources.table.derived import slope
from logs.identification.sources.table.quantities import SIGNALS
from logs.identification.sources.table.signals import LONGEST_FILL, Record
from wingbeat.errors import InputError
from wingbeat.schema import check_known, read_number, read_record
from wingbeat.text import pluralize

LONGEST = 0.5
"""s; skew that is looked for either way where nothing is told"""
LEAST_SMOOTHED = 40
"""-; samples on end that are smoothed"""
LONGEST_GIVEN = 60.0
"""s"""


class _Like(NamedTuple):
    like: str
    by: Annotated[str, "value", "slope"] = "value"
    longest: float = LONGEST


class Late(NamedTuple):
    """By how much a signal is late: told, or as its cross-correlation with another says."""

    seconds: float | None
    like: str = ""
    slope: bool = False
    """the other signal is like this one's slope"""
    longest: float = LONGEST

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Late:
        """Of a map's entry: seconds, or ``{ like = SIGNAL, by = "value"|"slope", longest = s }``.

        Raises:
            InputError: it is neither, or a time that cannot be.
        """
        if isinstance(entry, dict):
            told = read_record(_Like, entry, key)
            if not 0 < told.longest <= LONGEST_GIVEN:
                raise InputError(f"{key}.longest must be above 0 and at most {LONGEST_GIVEN:g} s")
            return cls(None, told.like, told.by == "slope", told.longest)
        seconds = read_number(entry, key)
        if abs(seconds) > LONGEST_GIVEN:
            raise InputError(f"{key} = {seconds:g} s is more than {LONGEST_GIVEN:g} s")
        return cls(seconds)


class PrepareSection(NamedTuple):
    """Section [prepare], done in this order."""

    delay: dict[str, Late] = {}
    """s; by which a signal is late, by its name"""
    smooth: dict[str, Annotated[str, "local_quadratic", "fourier", "spline", "rts", "stroke"]] = {}
    """method by signal; its slope, called NAME_dot, comes with it where it is not measured"""
    resample: float | None = None
    """Hz; after a low-pass that lets nothing through which would be folded"""


class Prepared(NamedTuple):
    """The records, and what was done to them."""

    records: list[Record]
    units: dict[str, str]
    notes: list[str]
    delays: tuple[Estimate, ...]
    """s; those that were measured, by the signal's name"""


def prepared(records: list[Record], units: dict[str, str], asked: PrepareSection) -> Prepared:
    """The ``records`` with late signals moved, smoothed and resampled as ``asked``.

    Raises:
        InputError: a signal that is not there, a skew that cannot be told, or a rate above that of a record.
    """
    for key, names in (("delay", asked.delay), ("smooth", asked.smooth)):
        for name in names:
            check_known(name, units, f"prepare.{key}.{name}")
    flown = [Experiment(record.file, record.time, record.signals, units) for record in records]
    notes: list[str] = []
    measured: list[Estimate] = []
    for name, late in asked.delay.items():
        flown = _moved(flown, name, late, notes, measured)
    for name, method in asked.smooth.items():
        flown = [_smoothed(one, name, method, notes) for one in flown]
    if asked.resample is not None:
        flown = [_resampled(one, asked.resample, notes) for one in flown]
    pairs = zip(records, flown, strict=True)
    whole = {name: unit for one in flown for name, unit in one.units.items()}
    return Prepared([_record(old, one) for old, one in pairs], whole, notes, tuple(measured))


def _moved(
    flown: list[Experiment], name: str, late: Late, notes: list[str], measured: list[Estimate]
) -> list[Experiment]:
    if late.seconds is not None:
        notes.append(f"{name}: moved forward by {late.seconds:g} s, as told")
        return [shifted(one, (name,), late.seconds) for one in flown]
    check_known(late.like, flown[0].signals, f"prepare.delay.{name}.like {late.like}")
    found = _skew(flown, name, late)
    measured.append(found)
    side = "the slope of " if late.slope else ""
    notes.append(
        f"{side}{name} is {found.value:.4g} s late behind {late.like}, {found.low:.4g} to {found.high:.4g} s (95 %):"
        f" {name} moved forward by it"
    )
    return [shifted(one, (name,), found.value) for one in flown]


def _skew(flown: list[Experiment], name: str, late: Late) -> Estimate:
    """By how much the signal is late, over all records: their mean, weighted with their errors.

    Raises:
        InputError: no record tells it.
    """
    found: list[Estimate] = []
    reasons: list[str] = []
    for one in flown:
        for piece in _whole(one, (name, late.like), 2.0 * late.longest + (LEAST - 1) * one.step):
            own = piece.signals[name]
            own = slope(own, piece.step) if late.slope else own
            told = skew_between(np.asarray(piece.signals[late.like]), own, piece.step, late.longest)
            if isinstance(told, Estimate):
                found.append(told)
            else:
                reasons.append(told.reason)
    if not found:
        why = reasons[0] if reasons else f"no record has both for {2 * late.longest:g} s on end"
        raise InputError(f"prepare.delay.{name}: its skew behind {late.like} is not told: {why}")
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


def _smoothed(one: Experiment, name: str, method: str, notes: list[str]) -> Experiment:
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
    left = f"; {pluralize(lost, 'sample')} in short pieces left out" if lost else ""
    unit = one.units.get(name, "")
    notes.append(f"{one.name}: {name} smoothed by {method}, noise of {max(taken):.3g} {unit} taken off{left}")
    made = {} if slope_name in one.signals else {slope_name: rates}
    told = {} if slope_name in one.signals else {slope_name: SIGNALS.get(slope_name, f"{unit}/s")}
    return one._replace(signals={**one.signals, name: clean, **made}, units={**one.units, **told})


def _resampled(one: Experiment, rate: float, notes: list[str]) -> Experiment:
    own = 1.0 / one.step
    if not 0.0 < rate <= own * (1 + 1e-6):
        raise InputError(f"prepare.resample = {rate:g} Hz is not above 0 and up to the {own:.4g} Hz of {one.name}")
    notes.append(f"{one.name}: {own:.4g} Hz low-passed and resampled to {rate:g} Hz")
    return down_sampled(one, max(1.0 / rate, one.step))


def _record(old: Record, one: Experiment) -> Record:
    """The prepared experiment as a record of the same table."""
    at = np.clip(np.searchsorted(old.time, one.time + 1e-9, side="right") - 1, 0, None)
    marks = None if old.marks is None else old.marks[at]
    return Record(old.file, one.time, old.rows[at], dict(one.signals), marks)
