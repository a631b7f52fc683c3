"""Names: `words_lint` counts identifiers with words that have a standard term; the counts only fall."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import words_lint

ROOT = Path(__file__).parents[1]
LIMITS = {"wingbeat": 0, "avionics": 0, "sim_bridge": 0, "logs": 0, "groundstation": 0, "tests": 0}
"""refused identifiers by package: lower a limit with every rename, never raise it"""


def test_refused_words_only_become_fewer() -> None:
    """GIVEN the names of all packages WHEN they are counted THEN there are no more refused ones than the limit.

    ``python tests/words_lint.py --list`` names them.
    """
    definitions = words_lint.all_identifiers(ROOT, words_lint.Options(everything=False, test_names=False))
    refused = words_lint.findings(definitions, words_lint.REFUSED)
    counts = Counter(each.identifier.file.partition("/")[0] for each in refused)
    assert {name: counts[name] for name in LIMITS if counts[name] > LIMITS[name]} == {}
