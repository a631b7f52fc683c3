"""The README's table of the levels of turbulence against the model, and the levels in what others tell of them."""

from __future__ import annotations

import re
from itertools import takewhile
from pathlib import Path

import pytest

import sim_bridge.environment
from logs.campaigns.keys import KEYS
from sim_bridge.environment.dryden import scale
from sim_bridge.environment.levels import LEVELS, LEVELS_TOLD

README = Path(sim_bridge.environment.__file__).with_name("README.md")
ANY_HEIGHT = 40.0
"""m; at which a row for any height is compared"""


def rows() -> list[tuple[str, str, list[str]]]:
    """Level, height and figures of every row of the table."""
    told, level = [], ""
    lines = README.read_text(encoding="utf-8").partition("| level |")[2].splitlines()[2:]
    for line in takewhile(lambda line: line.startswith("|"), lines):
        named, _, height, *figures = (cell.strip() for cell in line.strip("|").split("|"))
        level = named.strip("`") or level
        told.append((level, height, figures))
    return told


def test_the_readme_lists_every_level() -> None:
    assert tuple(dict.fromkeys(level for level, _, _ in rows())) == LEVELS


@pytest.mark.parametrize(("level", "height", "figures"), rows()[1:])
def test_the_figures_of_the_readme_are_the_models(level: str, height: str, figures: list[str]) -> None:
    size = scale(level, ANY_HEIGHT if height == "any" else float(height.removesuffix(" m")))
    level_intensity, down_intensity, level_length, down_length = map(float, figures)
    assert (size.level_intensity, size.down_intensity) == pytest.approx((level_intensity, down_intensity), abs=0.006)
    assert (size.level_length, size.down_length) == pytest.approx((level_length, down_length), abs=0.5)


def test_a_campaign_key_tells_every_level() -> None:
    assert re.findall(r"\w+", LEVELS_TOLD.replace(" or ", " ")) == list(LEVELS)
    assert LEVELS_TOLD in KEYS["turbulence"].text
