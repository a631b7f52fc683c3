"""Finding `outside_range`: a similarity number outside the range of an aerodynamic model."""

from __future__ import annotations

from collections.abc import Iterable

from logs.identification.findings import Entry, Finding, register
from sim_bridge.flight_mechanics.similarity import WORDS, RangeExcess

register({
    "outside_range": Entry(
        "{subject}: {quantity} {value:.3g} is outside the range of the model ({side} {limit:.3g}; {source})",
        "The aerodynamic model was not compared with measurements there, or its assumptions do not hold.",
        "choose a model that covers the flight (--aerodynamics), or treat the forces as an extrapolation",
    ),
})  # fmt: skip


def range_findings(excesses: Iterable[RangeExcess]) -> list[Finding]:
    """Convert numbers outside a range to warnings; the subject is the model."""
    return [
        Finding(
            "outside_range",
            "warning",
            one.model,
            one.value,
            one.limit,
            {
                "quantity": WORDS[one.quantity],
                "side": "at least" if one.value < one.limit else "at most",
                "source": one.source,
            },
        )
        for one in excesses
    ]
