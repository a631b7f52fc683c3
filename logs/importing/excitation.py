"""Identification inputs of a log of another program: when each maneuver ran, and what was added to the elevator."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping

import numpy as np

from avionics import topics as t
from logs.importing.counterparts import checked
from logs.importing.source import Array, ImportedTopic, Series

TOPICS = re.compile(r"excit|sysid|system_ident|chirp|multisine|^SIDD$|^EXCI$", re.I)
"""names of topics with an identification input"""
COLUMNS = (r"pitch|elev", r"^Targ$", r"value|output|signal|control|xyz")
"""patterns of the column with the input, in the order of preference"""
OTHER_AXIS = re.compile(r"roll|yaw|rudder|aileron|thr", re.I)
"""in the name of a topic whose input is not of the elevator"""
PITCH_AXES = {2: math.radians(1.0), 5: math.radians(1.0), 8: math.radians(1.0), 11: 0.5}
"""ArduPilot's SID_AXIS of pitch (angle, recovery angle, rate, mixer), and rad or rad/s per unit of the input"""
FULL_DEFLECTION = 0.5
"""rad; elevator at an input of 1"""
PAUSE = 1.0
"""s; a longer time without input separates two maneuvers"""
BEFORE, AFTER = 1.0, 1.2
"""s; of the motion beside an input that belongs to its maneuver"""


def excitation_topic(series: Mapping[str, Series], parameters: Mapping[str, float]) -> ImportedTopic | None:
    """Return the maneuvers of a log; None if it has no topic of an input in pitch.

    Args:
        series: of the log.
        parameters: of the log; ArduPilot's SID_AXIS tells the axis of SIDD.
    """
    for name in sorted(series):
        if not TOPICS.search(name) or OTHER_AXIS.search(name):
            continue
        scale = PITCH_AXES.get(int(parameters.get("SID_AXIS", 11)), 0.0) if name == "SIDD" else FULL_DEFLECTION
        values = _input(series[name])
        if values is not None and scale > 0.0:
            return _made(name, series[name], scale * values)
    return None


def _input(series: Series) -> Array | None:
    for pattern in COLUMNS:
        for name, column in series.columns.items():
            if column.dtype.kind == "f" and re.search(pattern, name, re.I):
                values = column if column.ndim == 1 else column[:, 1 if column.shape[1] > 1 else 0]
                if not np.nan_to_num(values).any() or np.nanstd(values) == 0.0:
                    continue  # a setting, not the input
                return np.asarray(np.nan_to_num(np.asarray(values, float)))
    return None


def _made(name: str, series: Series, values: Array) -> ImportedTopic:
    """Return the topic; the record of a maneuver ends half way to the next one at the latest."""
    time = series.time_us * 1e-6
    moving = np.flatnonzero(values)
    groups = np.split(moving, np.flatnonzero(np.diff(time[moving]) > PAUSE) + 1)
    spans = [(float(time[group[0]]), float(time[group[-1]])) for group in groups]
    edges = [0.5 * (last + first) for (_, last), (first, _) in itertools.pairwise(spans)]
    begins = [max(first - BEFORE, edge) for (first, _), edge in zip(spans, [-np.inf, *edges], strict=True)]
    ends = [min(last + AFTER, edge) for (_, last), edge in zip(spans, [*edges, np.inf], strict=True)]
    # A logger that writes only while the input runs does not record the motion beside it: times are added.
    extra = np.concatenate([np.array([begin, end]) for begin, end in zip(begins, ends, strict=True)])
    extra = extra[(extra < time[0]) | (extra > time[-1]) | np.isin(extra, begins) | np.isin(extra, ends)]
    stamps = np.unique(np.concatenate((series.time_us, np.rint(np.maximum(extra, 0.0) * 1e6).astype(np.int64))))
    at = stamps * 1e-6
    active, number = np.zeros(len(at)), np.zeros(len(at))
    for begin, end in zip(begins, ends, strict=True):
        active[(at >= begin - 1e-6) & (at < end - 1e-6)] = 1.0
        number[at >= begin - 1e-6] += 1.0
    row = np.clip(np.searchsorted(series.time_us, stamps, side="right") - 1, 0, None)
    held = np.where(np.isin(stamps, series.time_us), values[row], 0.0)
    columns = {
        "active": active,
        "manoeuvre": number,
        "elevator": held,
        "aborted": np.zeros(len(at)),
    }
    made = checked(t.EXCITATION, Series(name, stamps, {}, {}), columns)
    return made._replace(source=name)
