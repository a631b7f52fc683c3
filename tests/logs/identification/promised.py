"""What is promised of intervals and medians, told and asserted in one place for every study of many seeds.

95 % intervals hold the truth in 90 to 98 % of 300 seeds, each parameter. With 300 seeds a share scatters by 1.3 %.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import repeat

import numpy as np

from logs.identification.models.modes import Mode
from logs.identification.results import Estimate

SEEDS = range(300)
LEAST, MOST = 0.90, 0.98
HEAVY = 0.5
"""-; damping, above which the frequency may be twice as far off"""


Truth = Mapping[str, float]


def covered(results: Iterable[Sequence[Estimate]], truths: Truth | Sequence[Truth]) -> dict[str, float]:
    """Share of the intervals that hold the truth, of each parameter of the ``truths`` that was estimated.

    They are one for all or one for each of the ``results``, where a flight's own condition enters.
    """
    hits: dict[str, list[bool]] = {}
    for estimates, truth in zip(results, repeat(truths) if isinstance(truths, Mapping) else truths, strict=False):
        for one in estimates:
            if one.name in truth:
                hits.setdefault(one.name, []).append(one.contains(truth[one.name]))
    return {name: float(np.mean(inside)) for name, inside in hits.items()}


def promise_kept(study: str, shares: Mapping[str, float]) -> None:
    """Tell every share and demand the promise of each."""
    assert not missed(study, shares)


def missed(study: str, shares: Mapping[str, float]) -> list[str]:
    """Tell every share; what of the promise is not kept."""
    print(f"{study}:", ", ".join(f"{name} {100 * share:.1f} %" for name, share in shares.items()))  # noqa: T201
    outside = {name: share for name, share in shares.items() if not LEAST - 1e-9 <= share <= MOST + 1e-9}
    return [f"{study}: {outside or 'nothing was found'}"] if outside or not shares else []


def modes_kept(
    study: str, methods: Iterable[Sequence[Mode]], truths: Truth | Sequence[Truth], least_given: float = 0.95
) -> None:
    """The promise of each method's short period and derivatives, its medians, and how often it gave a number.

    The ``truths`` as `covered` takes them. Every method's figures are told before the first that misses the promise
    is complained of.
    """
    assert not [line for modes in methods for line in _missed_of(study, modes, truths, least_given)]


def _missed_of(study: str, modes: Sequence[Mode], truths: Truth | Sequence[Truth], least_given: float) -> list[str]:
    each = [truths] * len(modes) if isinstance(truths, Mapping) else truths
    told = [(mode, truth) for mode, truth in zip(modes, each, strict=True) if mode.frequency is not None]
    given, true = [mode for mode, _ in told], [truth for _, truth in told]
    what = f"{study}, {modes[0].method} ({len(given)} of {len(modes)} give a number)"
    if not given:
        return [what]
    estimates = [(*pairs(mode), *mode.derivatives) for mode in given]
    right = np.array([[truth[f"short_period_{name}"] for name in ("frequency", "damping")] for truth in true])
    frequency, damping = np.median(right, axis=0)
    errors = np.array([[estimates.value for estimates in pairs(mode)] for mode in given]) - right
    medians = np.median(np.abs(errors), axis=0) / (frequency, 1.0)
    median_errors = f"{what}: median errors {100 * medians[0]:.2f} % and {medians[1]:.4f}"
    print(median_errors)  # noqa: T201
    near = medians[0] <= (0.10 if damping > HEAVY else 0.05) and medians[1] <= max(0.01, 0.15 * damping)
    few = [what] if len(given) < least_given * len(modes) else []
    return [*few, *([] if near else [median_errors]), *missed(what, covered(estimates, true))]


def pairs(mode: Mode) -> tuple[Estimate, Estimate]:
    """Frequency and damping of a mode that has them."""
    assert mode.frequency is not None and mode.damping is not None
    return mode.frequency, mode.damping
