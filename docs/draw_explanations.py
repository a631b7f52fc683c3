"""Draw the figures of ``docs/explanation/``: ``python docs/draw_explanations.py LOG.mcap docs/explanation``.

LOG is a flight of ``wingbeat fly`` with its default options.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from control import forced_response
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import lfilter

import wingbeat
from avionics import topics
from logs.identification.estimators.least_squares import regress
from logs.reader import Log, open_log
from sim_bridge import topics as truth

Array = NDArray[np.float64]
INK, BLUE, ORANGE, GREEN, GREY = "#22313f", "#1f6f8b", "#e07a3f", "#4c9a6a", "#b8c4cc"
STEADY = 42.0
"""s; within the level hold of the circuit, without excitation"""


def draw_stroke(log: Log) -> Figure:
    """Wing angle and force of the wings over three strokes of level flight."""
    wing, loads, state = (log.columns(one) for one in (truth.WING, truth.LOADS, truth.STATE))
    period = 1.0 / float(np.median(log.columns(topics.WING)["frequency"]))
    figure, (top, bottom) = plt.subplots(
        2, 1, figsize=(8, 4.4), sharex=True, height_ratios=[1, 2], layout="constrained"
    )
    inside = _between(wing.time, STEADY, STEADY + 3.0 * period)
    top.plot(wing.time[inside] - STEADY, np.degrees(wing["angle_left"][inside]), color=INK, lw=1.8)
    top.set(ylabel="degrees", title="flap angle")
    inside = _between(loads.time, STEADY, STEADY + 3.0 * period)
    quaternion = [state[f"quaternion_{axis}"] for axis in "wxyz"]
    w, x, y, z = (np.interp(loads.time[inside], state.time, one) for one in quaternion)
    force_x, force_z = loads["wing_force_x"][inside], loads["wing_force_z"][inside]
    up = -(2.0 * (x * z - w * y) * force_x + (1.0 - 2.0 * (x * x + y * y)) * force_z)
    ahead = np.hypot(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)) * force_x + 2.0 * (x * z + w * y) * force_z
    for force, color, label in ((up, BLUE, "vertical"), (ahead, ORANGE, "horizontal, forward")):
        bottom.plot(loads.time[inside] - STEADY, force, color=color, lw=1.8, label=label)
        bottom.axhline(force.mean(), color=color, lw=1.2, ls="--")
    bottom.plot([], [], color=GREY, ls="--", label="means over the strokes")
    bottom.axhline(0.0, color=GREY, lw=0.8)
    bottom.set(xlabel="time (s)", ylabel="N", title="aerodynamic force of both wings")
    bottom.legend(frameon=False, ncols=3, loc="upper right")
    bottom.margins(y=0.2)
    return figure


def draw_attitude(log: Log) -> Figure:
    """Pitch from single accelerometer samples, of the filter, and true."""
    imu, estimate, state = (log.columns(one) for one in (topics.IMU, topics.ATTITUDE, truth.STATE))
    figure, panels = plt.subplots(2, 1, figsize=(8, 4.4), sharex=True, layout="constrained")
    w, x, y, z = (state[f"quaternion_{axis}"] for axis in "wxyz")
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    single = np.arctan2(imu["accel_x"], -imu["accel_z"])
    for panel, time, angle, style in (
        (0, imu.time, single, {"color": GREY, "lw": 1.0, "label": "direction of each accelerometer sample"}),
        (0, state.time, pitch, {"color": INK, "lw": 2.0, "label": "true"}),
        (1, state.time, pitch, {"color": INK, "lw": 3.0, "label": "true"}),
        (1, estimate.time, estimate["pitch"], {"color": ORANGE, "lw": 1.3, "label": "attitude filter"}),
    ):
        inside = _between(time, STEADY, STEADY + 3.0)
        panels[panel].plot(time[inside] - STEADY, np.degrees(angle[inside]), **style)
    panels[0].set_title("pitch in level flight")
    panels[1].set_xlabel("time (s)")
    for panel in panels:
        panel.set_ylabel("degrees")
        panel.margins(y=0.35)
        panel.legend(frameon=False, ncols=2, loc="upper right")
    return figure


def draw_short_period(log: Log) -> Figure:
    """Eigenvalues of two vehicles, and the answer of one to a doublet beside its linear model."""
    figure, (plane, answer) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    for name, color in (("robo_raven_ii_d", BLUE), ("arizona_100cm", ORANGE)):
        poles = wingbeat.linearize(name).longitudinal().poles()
        plane.plot(poles.real, poles.imag, "x", color=color, ms=9, mew=2, label=name)
    plane.axvline(0.0, color=GREY, lw=0.8)
    plane.axhline(0.0, color=GREY, lw=0.8)
    plane.set(xlabel="real part (1/s)", ylabel="imaginary part (rad/s)", title="longitudinal modes")
    plane.annotate("short period", (-7.0, 6.7), xytext=(-4.9, 4.5), arrowprops={"arrowstyle": "-", "color": INK})
    plane.annotate("phugoid", (-0.15, 1.2), xytext=(-3.6, 1.8), arrowprops={"arrowstyle": "-", "color": INK})
    plane.legend(frameon=False, loc="lower center")

    excitation, attitude, wing = (log.columns(one) for one in (topics.EXCITATION, topics.ATTITUDE, topics.WING))
    begin = float(excitation.time[np.abs(excitation["elevator"]) > 0.0][0])
    period = 1.0 / float(np.median(wing["frequency"]))
    time = np.arange(begin - 1.0, begin + 0.9, 0.005)
    rate = np.interp(time, attitude.time, attitude["pitch_rate"])
    achieved = log.columns(truth.WING)
    elevator = np.interp(time, achieved.time, achieved["elevator"])
    rate, elevator = rate - rate[time < begin - 0.5].mean(), elevator - elevator[time < begin].mean()
    model = wingbeat.linearize("robo_raven_ii_d").longitudinal()
    computed = forced_response(model[model.state_labels.index("q"), 0], time - time[0], elevator).outputs
    kernel = np.ones(round(period / 0.005)) / round(period / 0.005)
    for values, color, width, label in (
        (np.convolve(rate, kernel, "same"), INK, 3.0, "flight, mean over a stroke"),
        (np.convolve(computed, kernel, "same"), ORANGE, 1.5, "linear model, mean over a stroke"),
    ):
        answer.plot(time - begin, np.degrees(values), color=color, lw=width, label=label)
    answer.plot(time - begin, np.degrees(rate), color=GREY, lw=0.8, label="flight", zorder=0)
    answer.plot(time - begin, np.degrees(elevator), color=GREEN, lw=1.2, label="elevator deflection (degrees)")
    answer.set(
        xlabel="time (s)", ylabel="pitch rate (degrees/s)", title="a doublet", xlim=(-0.3, 0.75), ylim=(-75, 60)
    )
    answer.legend(frameon=False, fontsize=9, loc="lower left")
    return figure


def draw_intervals(log: Log) -> Figure:
    """Intervals of one coefficient from 50 simulated records, with two assumptions about the residuals."""
    generator = np.random.default_rng(1)
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), sharey=True, layout="constrained")
    truth_value, count = -8.0, 50
    for record in range(count):
        time = np.arange(0.0, 10.0, 0.02)
        motion = lfilter([0.02], [1.0, -0.98], generator.normal(size=len(time)))
        residual = lfilter([0.1], [1.0, -0.9], generator.normal(size=len(time)))
        response = truth_value * motion + residual
        for panel, kind in zip(axes, ("white", "autocorrelated"), strict=True):
            fit = regress(motion[:, None], response, np.ones(len(time)), covariance=kind)
            half = 1.96 * float(np.sqrt(fit.covariance[0, 0]))
            hit = abs(fit.values[0] - truth_value) <= half
            panel.plot([record] * 2, fit.values[0] + np.array([-half, half]), color=BLUE if hit else ORANGE, lw=2)
            panel.hits = getattr(panel, "hits", 0) + hit
    for panel, title in zip(
        axes, ("residuals taken as independent", "residuals as they are: autocorrelated"), strict=True
    ):
        panel.axhline(truth_value, color=INK, lw=1.0)
        panel.set(xlabel="record", title=f"{title}\n{panel.hits} of {count} intervals contain the true value")
    axes[0].set_ylabel("estimate, 1/s")
    return figure


def _between(time: Array, start: float, end: float) -> NDArray[np.bool_]:
    return (time >= start) & (time < end)


FIGURES: dict[str, Callable[[Log], Figure]] = {
    "stroke": draw_stroke,
    "attitude": draw_attitude,
    "short_period": draw_short_period,
    "intervals": draw_intervals,
}


def draw(log: Log, folder: Path) -> None:
    """Write every figure as PNG."""
    plt.rcParams.update(
        {"font.size": 10, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": INK}
    )
    for name, figure in FIGURES.items():
        figure(log).savefig(folder / f"{name}.png", dpi=90)


if __name__ == "__main__":
    with open_log(sys.argv[1]) as flight:
        draw(flight, Path(sys.argv[2]))
