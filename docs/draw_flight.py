"""Draw the picture of the README from a flight's log: ``python docs/draw_flight.py LOG.mcap docs/flight.png``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

from avionics import topics
from logs.reader import Log, open_log
from sim_bridge import topics as truth

INK, BLUE, ORANGE, GREY = "#22313f", "#1f6f8b", "#e07a3f", "#b8c4cc"
MOMENT = 1.5
"""s; of wing motion that is shown"""


def draw_track(axes: Any, log: Log) -> None:
    """The track from above, coloured by altitude."""
    state = log.columns(truth.STATE)
    east, north, altitude = state["east"], state["north"], -state["down"]
    points = np.column_stack((east, north))[::20]
    pieces = LineCollection(np.stack((points[:-1], points[1:]), axis=1), cmap="viridis", linewidths=2.5)
    pieces.set_array(altitude[::20])
    axes.add_collection(pieces)
    axes.plot(east[0], north[0], "o", color=ORANGE, label="launch")
    axes.plot(east[-1], north[-1], "s", color=INK, label="touchdown")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.08)
    axes.set(xlabel="east (m)", ylabel="north (m)", title="track")
    axes.legend(frameon=False, loc="lower left")
    axes.figure.colorbar(pieces, ax=axes, label="altitude (m)", shrink=0.8)


def draw_altitude(axes: Any, log: Log) -> None:
    """Altitude, true and as estimated, with the identification inputs marked."""
    state, estimate = log.columns(truth.STATE), log.columns(topics.ALTITUDE)
    excitation = log.columns(topics.EXCITATION)
    ground = -float(state["down"][0])
    axes.plot(state.time, -state["down"], color=GREY, linewidth=4, label="true")
    axes.plot(estimate.time, estimate["altitude"] + ground, color=BLUE, linewidth=1.2, label="flight computer")
    active = excitation["active"] > 0
    axes.fill_between(excitation.time, 0, 45, where=active, color=ORANGE, alpha=0.25, lw=0, label="doublets")
    axes.set(xlabel="time (s)", ylabel="m", title="altitude above ground", ylim=(0, 45))
    axes.legend(frameon=False, loc="lower center", ncols=3)


def draw_wings(axes: Any, log: Log, start: float) -> None:
    """What the wing was told and what it did."""
    wing, asked = log.columns(topics.WING), log.columns(topics.ACTUATORS)
    for columns, field, colour, label in (
        (asked, "wing_left", GREY, "commanded"),
        (wing, "angle_left", BLUE, "encoder"),
    ):
        inside = (columns.time >= start) & (columns.time < start + MOMENT)
        axes.plot(columns.time[inside], np.degrees(columns[field][inside]), color=colour, lw=1.8, label=label)
    axes.set(xlabel="time (s)", ylabel="degrees", title="left wing", ylim=(-45, 55))
    axes.legend(frameon=False, loc="lower right", ncols=2)


def draw_doublet(axes: Any, log: Log) -> None:
    """The last doublet and the pitch rate that it made, with the wing beat in it."""
    excitation, attitude = log.columns(topics.EXCITATION), log.columns(topics.ATTITUDE)
    last = excitation["manoeuvre"] == excitation["manoeuvre"].max()
    begin, end = excitation.time[last & (excitation["active"] > 0)][[0, -1]]
    for columns, field, colour, label in (
        (attitude, "pitch_rate", BLUE, "pitch rate (degrees/s)"),
        (excitation, "elevator", ORANGE, "elevator input (degrees)"),
    ):
        inside = (columns.time >= begin) & (columns.time <= end)
        axes.plot(columns.time[inside], np.degrees(columns[field][inside]), color=colour, lw=1.5, label=label)
    axes.set(xlabel="time (s)", title="a doublet for identification", ylim=(-60, 75))
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.35 * (high - low))
    axes.legend(frameon=False, loc="upper right")


def draw(log: Log, out: Path) -> None:
    """Write the picture."""
    plt.rcParams.update(
        {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": INK}
    )
    figure, axes = plt.subplot_mosaic(
        [["track", "altitude", "altitude"], ["track", "wings", "doublet"]],
        figsize=(14, 6), width_ratios=[1.25, 1, 1], layout="constrained",
    )  # fmt: skip
    draw_track(axes["track"], log)
    draw_altitude(axes["altitude"], log)
    draw_wings(axes["wings"], log, 20.0)
    draw_doublet(axes["doublet"], log)
    figure.savefig(out, dpi=80)


if __name__ == "__main__":
    with open_log(sys.argv[1]) as flight:
        draw(flight, Path(sys.argv[2]))
