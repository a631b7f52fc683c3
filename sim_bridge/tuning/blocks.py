"""The parts that stand between a loop's command and what it measures, as python-control systems with named signals.

Python-control is imported where it is needed, for it takes half a second, which a flight need not wait for.
"""

from __future__ import annotations

import math
from typing import Any

PADE_ORDER = 3
"""-; of a delay: accurate within 1 degree up to a lag of 4 rad"""


def delay(seconds: float, source: str, target: str) -> Any:
    """Build a delay by Padé approximation, from signal ``source`` to ``target``."""
    import control

    return _named(control.tf(*control.pade(seconds, PADE_ORDER)), source, target)


def lag(seconds: float, source: str, target: str) -> Any:
    """Build a first-order lag; a lag of 0 s is a unit gain."""
    import control

    return _named(control.tf([1.0], [seconds, 1.0] if seconds > 0.0 else [1.0]), source, target)


def notch(frequency: float, width: float, source: str, target: str) -> Any:
    """Build the filter of `avionics.stabilization.stroke_filter` at ``frequency`` Hz with damping ratio ``width``."""
    import control

    w = 2.0 * math.pi * frequency
    if w <= 0.0 or width <= 0.0:
        return lag(0.0, source, target)
    return _named(control.tf([1.0, 0.0, w * w], [1.0, 2.0 * width * w, w * w]), source, target)


def stroke_mean(frequency: float, source: str, target: str) -> Any:
    """Build the mean over a stroke of ``frequency`` Hz, (1 - exp(-sT))/(sT), by a Padé approximation."""
    return lag(0.5 / frequency if frequency > 0.0 else 0.0, source, target)


def gain(value: float, source: str, target: str) -> Any:
    """Build a constant gain."""
    import control

    return _named(control.tf([value], [1.0]), source, target)


def controller(
    terms: tuple[float, float, float], signals: tuple[str, str, str, str], setpoint_weight: float = 1.0
) -> Any:
    """Build a controller: proportional and integral on the error, damping on a measured rate.

    Args:
        terms: proportional, integral, damping.
        signals: names of setpoint, measured value, measured rate, command.
        setpoint_weight: fraction of the proportional term that acts on the setpoint.
    """
    import control

    proportional, integral, damping = terms
    setpoint, measured, rate, command = signals
    return control.ss(
        [[0.0]],
        [[1.0, -1.0, 0.0]],
        [[integral]],
        [[setpoint_weight * proportional, -proportional, -damping]],
        inputs=[setpoint, measured, rate],
        outputs=[command],
        name=f"controller of {measured}",
    )


def joined(systems: list[Any], inputs: list[str], outputs: list[str]) -> Any:
    """Connect the systems at signals of the same name; signals of several sources are added."""
    import control

    return control.interconnect(systems, inputs=inputs, outputs=outputs, check_unused=False)


def _named(system: Any, source: str, target: str) -> Any:
    import control

    return control.ss(system, inputs=[source], outputs=[target], name=f"{source} to {target}")
