"""A planned input as it is given to the aircraft: an item of a mission file, or a command from the ground."""

from __future__ import annotations

import math

from avionics.guidance.mission import Excitation, Shape

WORDS = {
    Shape.DOUBLET: "doublet",
    Shape.MULTISTEP_3211: "3211",
    Shape.LINEAR_SWEEP: "sweep",
    Shape.LOGARITHMIC_SWEEP: "log_sweep",
    Shape.MULTISINE: "multisine",
}


def mission_item(excitation: Excitation) -> str:
    """The ``[[item]]`` of a mission file that flies it (on the elevator)."""
    amplitude = f"{math.degrees(excitation.amplitude):.4g}"
    channel = [] if excitation.shape == Shape.MULTISINE else ['channel = "elevator"']
    lines = ["[[item]]", 'kind = "excite"', f'shape = "{WORDS[excitation.shape]}"', *channel]
    lines += [f"{key} = {value}" for key, value in _numbers(excitation, amplitude).items()]
    lines += [f"settle = {excitation.settle:g}", f"repeats = {excitation.repeats}"]
    return "\n".join(lines) + "\n"


def _numbers(excitation: Excitation, amplitude: str) -> dict[str, str]:
    width, low, high = (f"{value:g}" for value in (excitation.width, excitation.low, excitation.high))
    if excitation.shape == Shape.MULTISINE:
        return {"elevator_deg": amplitude, "period": width, "low": low, "high": high}
    if excitation.shape in (Shape.LINEAR_SWEEP, Shape.LOGARITHMIC_SWEEP):
        return {"amplitude_deg": amplitude, "start": low, "end": high, "duration": width}
    return {"amplitude_deg": amplitude, "width": width}


def command_line(excitation: Excitation, url: str = "URL") -> str:
    """The ``wingbeat gcs`` command that flies it."""
    numbers = _numbers(excitation, f"{math.degrees(excitation.amplitude):.4g}")
    options = {key.removesuffix("_deg"): value for key, value in numbers.items()}
    options |= {"settle": f"{excitation.settle:g}", "repeats": str(excitation.repeats)}
    channel = [] if excitation.shape == Shape.MULTISINE else ["elevator"]
    flags = [f"--{key} {value}" for key, value in options.items()]
    return " ".join(["wingbeat gcs", url, "excite", WORDS[excitation.shape], *channel, *flags])
