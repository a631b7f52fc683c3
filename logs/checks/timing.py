"""Checks of the time stamps of every topic: gaps, rate changes, backward and repeated times."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from logs.checks.findings import Finding
from logs.checks.log_data import Array, LogData, RawTopic
from logs.importing.checks import nearly_ordered

ROWS = 20
"""least rows of a topic with a rate"""
APART = 3.0
"""s; events of one kind that are closer are one finding"""
STEADY, STEADY_SHARE = 0.5, 0.9
"""-; a topic has a rate if this share of its periods is within a fraction of the period before"""
FEW_GAPS = 2
"""gaps; a topic with more, and more than one in a hundred messages, is logged on changes"""
SHARED = 5
"""topics with the same gap: the logger stopped"""
GAP_FACTOR, SHORTEST_GAP = 4.0, 0.1
"""-, s; a gap is longer than this multiple of the usual period, and than this time"""
RATE_CHANGE = 1.25
"""-; ratio of the rates before and after"""
RATE_WINDOW = 2.0
"""s; before and after a change"""
SLOWEST_RATE = 4.0
"""Hz; slower topics are often sent on changes besides"""


def check_timing(log: LogData) -> Iterator[Finding]:
    """Check the time stamps of all topics."""
    gaps: list[Finding] = []
    for topic in log.raw:
        if len(topic.time) >= ROWS:
            yield from _backwards(topic)
            yield from _repeated(topic)
            time = np.sort(topic.time[nearly_ordered(np.rint(topic.time * 1e6).astype(np.int64))])
            steps = np.diff(time)
            if _steady(steps[steps > 0.0]):
                gaps += _gaps(topic.name, time, steps)
                yield from _rate_changes(topic.name, time, steps)
    yield from _joined(gaps)


def _joined(gaps: list[Finding]) -> Iterator[Finding]:
    """Join the gaps of many topics at one moment to one."""
    rest = sorted(gaps, key=lambda one: one.start)
    while rest:
        first = rest[0]
        near = 0.25 * first.value
        same = [one for one in rest if abs(one.start - first.start) < near and abs(one.end - first.end) < near]
        if len(same) < SHARED:
            yield first
            rest = rest[1:]
            continue
        shortest = min(same, key=lambda one: one.value)
        text = f"{shortest.text}, and in {len(same) - 1} other topics: the logger stopped"
        yield shortest._replace(text=text)
        rest = [one for one in rest if one not in same]


def _backwards(topic: RawTopic) -> Iterator[Finding]:
    back = np.flatnonzero(np.diff(topic.time) < 0.0)
    for rows in clusters(topic.time[back]):
        places = back[rows]
        start, end = float(topic.time[places[0]]), float(topic.time[places[-1]])
        size = float(-np.diff(topic.time)[places].min())
        text = f"time stamps run backwards {len(places)} times, by up to {size:.4g} s"
        yield Finding("time_backwards", "error", topic.name, start, end, float(len(places)), text)


def _repeated(topic: RawTopic) -> Iterator[Finding]:
    """Repeated stamps in a topic that has a rate; events of one moment are no fault."""
    steps = np.diff(topic.time)
    same = np.flatnonzero(steps == 0.0)
    if not len(same) or len(same) > 0.5 * len(steps) or not _steady(steps[steps > 0.0]):
        return
    for rows in clusters(topic.time[same]):
        if len(rows) >= 2:
            times = topic.time[same[rows]]
            text = f"{len(rows)} time stamps repeat the one before"
            yield Finding(
                "time_repeated", "warning", topic.name, float(times[0]), float(times[-1]), float(len(rows)), text
            )


def _gaps(name: str, time: Array, steps: Array) -> list[Finding]:
    usual = float(np.median(steps[steps > 0.0]))
    gaps = np.flatnonzero(steps > _gap_limit(steps))
    if len(gaps) > max(FEW_GAPS, 0.01 * len(steps)):
        return []  # logged in bursts or on changes
    texts = [f"no message for {steps[row]:.3g} s at {1.0 / usual:.3g} Hz" for row in gaps.tolist()]
    return [
        Finding("gap", "warning", name, float(time[row]), float(time[row + 1]), float(steps[row]), text)
        for row, text in zip(gaps.tolist(), texts, strict=True)
    ]


def _gap_limit(steps: Array) -> float:
    positive = steps[steps > 0.0]
    return max(GAP_FACTOR * max(float(np.median(positive)), float(np.percentile(positive, 90))), SHORTEST_GAP)


def _rate_changes(name: str, time: Array, steps: Array) -> Iterator[Finding]:
    """Find moments at which the number of messages per second changes for good."""
    usable = (steps <= _gap_limit(steps)) & (steps > 0.0)
    moments, periods = time[:-1][usable], steps[usable]
    window = RATE_WINDOW
    if len(moments) < 2 * ROWS or 1.0 / float(np.median(periods)) < SLOWEST_RATE or time[-1] - time[0] < 2.0 * window:
        return
    # Centers lie at messages, so that pauses of the log cost nothing.
    places = np.arange(0, len(moments), max(1, int(0.1 * window / float(np.median(periods)))))
    centers = moments[places]
    centers = centers[(centers >= time[0] + window) & (centers <= time[-1] - window)]
    before = _mean_period(moments, periods, centers - window, window)
    after = _mean_period(moments, periods, centers, window)
    size = np.nan_to_num(np.abs(np.log(after / before)), nan=0.0, posinf=0.0)
    while len(size) and size.max() > math.log(RATE_CHANGE):
        center = float(centers[int(size.argmax())])
        at = _change_point(moments, periods, center, window)
        rates = [1.0 / float(_mean_period(moments, periods, np.array([one]), window)[0]) for one in (at - window, at)]
        size[np.abs(centers - center) <= 2.0 * window] = 0.0
        if not all(map(math.isfinite, rates)):
            continue
        text = f"the rate changes from {rates[0]:.4g} to {rates[1]:.4g} Hz"
        yield Finding("rate_change", "warning", name, at, at, rates[1] / rates[0], text)


def _mean_period(moments: Array, periods: Array, begins: Array, window: float) -> Array:
    """Return the mean period in s of the messages in windows from ``begins`` on; NaN for fewer than five."""
    sums = np.concatenate(([0.0], np.cumsum(periods)))
    first, last = np.searchsorted(moments, begins), np.searchsorted(moments, begins + window)
    count = last - first
    mean: Array = np.where(count >= 5, (sums[last] - sums[first]) / np.maximum(count, 1), np.nan)
    return mean


def _change_point(moments: Array, steps: Array, center: float, window: float) -> float:
    """Return the time in a window that divides the periods into the two most different parts."""
    inside = np.flatnonzero((moments >= center - window) & (moments <= center + window))
    values = np.log(np.maximum(steps[inside], 1e-6))
    return center if len(values) < 4 else float(moments[inside[change_point(values)]])


def change_point(values: Array) -> int:
    """Return the index that divides values into the two parts with the most different means."""
    count, left = len(values), np.cumsum(values)[:-1]
    n = np.arange(1, count)
    between = (left / n - (values.sum() - left) / (count - n)) ** 2 * n * (count - n)
    return int(between.argmax()) + 1


def _steady(steps: Array) -> bool:
    """Return whether most periods resemble the one before: the topic has a rate, though it may change."""
    if len(steps) < ROWS // 2:
        return False
    ratio = np.abs(np.log(steps[1:] / steps[:-1]))
    return float(np.mean(ratio <= math.log(1.0 + STEADY))) >= STEADY_SHARE


def clusters(times: Array, spacing: float = APART) -> list[NDArray[np.int64]]:
    """Return the indices of times that lie closer than ``spacing`` s, one array each."""
    if not len(times):
        return []
    return list(np.split(np.arange(len(times)), np.flatnonzero(np.abs(np.diff(times)) > spacing) + 1))


def runs(mask: NDArray[np.bool_]) -> Sequence[tuple[int, int]]:
    """Return first and last index + 1 of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))
