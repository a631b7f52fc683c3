"""Plots of flights (matplotlib)."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from avionics import topics
from logs.identification.results import EstimationResult
from logs.reader import Log
from sim_bridge import topics as truth
from wingbeat.rotation_arrays import euler_from_quaternions

__all__ = ["plot_fit", "plot_flight"]

ESTIMATE, TRUE = "tab:blue", "0.7"


def plot_flight(log: Log) -> Figure:
    """Plot altitude, airspeed, attitude, flapping frequency and electrical power over time.

    Estimates of the flight computer are blue, true values of a simulated flight gray.
    """
    figure, axes = plt.subplots(5, 1, sharex=True, figsize=(9.0, 10.0), layout="constrained")
    state = log.columns(truth.STATE) if log.is_native(truth.STATE) else None
    if state is not None:
        roll, pitch, _ = euler_from_quaternions(*(state[f"quaternion_{axis}"] for axis in "wxyz"))
        axes[0].plot(state.time, -state["down"] + state["down"][0], color=TRUE, linewidth=3.0)
        axes[1].plot(state.time, state["airspeed"], color=TRUE, linewidth=3.0)
        axes[2].plot(state.time, np.degrees(np.column_stack((roll, pitch))), color=TRUE, linewidth=3.0)
    _draw(axes[0], log, topics.ALTITUDE, ("altitude",), "altitude (m)")
    _draw(axes[1], log, topics.AIR_DATA, ("airspeed",), "airspeed (m/s)")
    _draw(axes[2], log, topics.ATTITUDE, ("roll", "pitch"), "roll, pitch (deg)", 180.0 / np.pi)
    _draw(axes[3], log, topics.WING, ("frequency",), "flapping (Hz)")
    _draw(axes[4], log, topics.POWER, ("power",), "power (W)")
    axes[4].set_xlabel("time since boot (s)")
    figure.suptitle(log.path.name)
    return figure


def _draw(axes: Any, log: Log, topic: Any, fields: tuple[str, ...], label: str, scale: float = 1.0) -> None:
    axes.set_ylabel(label)
    axes.grid(alpha=0.3)
    if not log.is_native(topic):
        return
    columns = log.columns(topic)
    for name, style in zip(fields, ("-", "--"), strict=False):
        axes.plot(columns.time, scale * columns[name], style, color=ESTIMATE, linewidth=1.0, label=name)
    if len(fields) > 1:
        axes.legend(loc="upper right")


def plot_fit(title: str, result: EstimationResult) -> Figure:
    """Plot the measured and the modeled outputs of one result, one row per output; predictions are dashed."""
    outputs = tuple(dict.fromkeys(one.output for one in result.series))
    figure, axes = plt.subplots(
        len(outputs), 1, sharex=True, squeeze=False, figsize=(9.0, 2.0 * len(outputs) + 1.0), layout="constrained"
    )
    for row, output in enumerate(outputs):
        panel = axes[row, 0]
        for one in (series for series in result.series if series.output == output):
            panel.plot(one.time, one.measured, color=TRUE, linewidth=3.0)
            panel.plot(one.time, one.model, "--" if one.held_out else "-", color=ESTIMATE, linewidth=1.0)
            panel.set_ylabel(f"{output} ({one.unit})")
        panel.grid(alpha=0.3)
    axes[-1, 0].set_xlabel("time (s)")
    figure.suptitle(f"{title}: measured gray, model blue")
    return figure
