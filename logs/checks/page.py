"""Page of a checked log: its findings, and the signals that they are about."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from logs.checks.findings import Finding
from logs.checks.log_data import Signal
from logs.checks.run import LogReport
from logs.pages.document import MEASURED, MODEL, OTHER, Chapter, Plot, Remark, Series, Table
from logs.pages.render import write_page

ROLES = {
    "accel": ("m/s^2", ("x", "y", "z")), "gyro": ("rad/s", ("x", "y", "z")),
    "attitude": ("rad", ("roll", "pitch", "yaw")), "airspeed": ("m/s", ("",)), "flap_frequency": ("Hz", ("",)),
    "current": ("A", ("",)), "voltage": ("V", ("",)), "surfaces": ("-", ("1", "2", "3")),
    "position": ("m", ("north", "east")),
}  # fmt: skip
"""unit and names of the lines of each plotted signal"""


def write(path: Path, report: LogReport) -> int:
    """Write the page to ``path``, which must not exist; return its size in bytes.

    Raises:
        InputError: the file exists or cannot be written.
    """
    log = report.log
    facts = (log.kind, f"{log.duration:.1f} s", f"{len(log.raw)} topics")
    return write_page(path, f"Check of {log.name}", facts, (_findings(report), _signals(report)))


def _findings(report: LogReport) -> Chapter:
    remarks = tuple(
        Remark(one.severity, one.code, f"{one.topic} {_time(one)}: {one.text}".strip(), one.remedy)
        for one in report.findings
    )
    rows = tuple(
        (one.severity, one.code, one.topic, one.start, one.end, one.value if np.isfinite(one.value) else None)
        for one in report.findings
    )
    heads = ("severity", "code", "topic", "start (s)", "end (s)", "value")
    notes = () if report.findings else ("No finding.",)
    return Chapter("Findings", notes, (Table(heads, rows),) if rows else (), findings=remarks)


def _time(finding: Finding) -> str:
    if finding.end - finding.start < 0.01:
        return f"at {finding.start:.2f} s"
    return f"{finding.start:.2f} to {finding.end:.2f} s"


def _signals(report: LogReport) -> Chapter:
    plots = []
    for role, (unit, names) in ROLES.items():
        signal = report.log.signals.get(role)
        if signal is not None and len(signal.time) > 1:
            marks = [
                (one.start, one.code) for one in report.findings if one.topic == signal.topic and one.start > 0.0
            ]
            title = f"{role.replace('_', ' ')} ({signal.topic})"
            lines = _lines(signal, names)
            plots.append(Plot(title, "time", "s", role.replace("_", " "), unit, lines, marks=tuple(marks)))
    return Chapter("Signals", plots=tuple(plots))


def _lines(signal: Signal, names: tuple[str, ...]) -> tuple[Series, ...]:
    columns = signal.values.T[: len(names)]
    return tuple(
        Series(name, signal.time, values, color)
        for name, values, color in zip(names, columns, (MEASURED, MODEL, OTHER), strict=False)
    )
