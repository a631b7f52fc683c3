"""Campaign files and the values of each flight."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from logs.campaigns.distributions import Distribution, drawn, read_distribution
from logs.campaigns.keys import Values, check_key, check_value
from logs.campaigns.outcome import Landing
from logs.campaigns.prepared import prepare
from logs.campaigns.stock import DEFAULT_MISSION, DEFAULT_VEHICLE, Stock, load_stock
from wingbeat.errors import InputError
from wingbeat.schema import check_keys, check_table, error_context, read_document, read_integer, read_record
from wingbeat.units import ABOVE_ZERO, Quantity

SECTIONS = ("flight", "grid", "draw", "landing")
PLAIN = ("name", "title", "seed", "flights")
MOST = 1_000_000
"""-; limit of the flights in a campaign: a larger grid is probably a mistake"""


class Campaign(NamedTuple):
    """Validated campaign file."""

    name: str
    title: str
    path: Path
    seed: int
    """-; seed of the first draw; the flights of draw j, counted from 0, have the seed ``seed + j``"""
    draws: int
    """-; number of flights at each point of the grid"""
    fixed: Values
    """values common to all flights"""
    grid: Mapping[str, Sequence[Any]]
    draw: Mapping[str, Distribution]
    landing: Landing
    stock: Stock

    @property
    def points(self) -> int:
        """Number of points of the grid; 1 without a grid."""
        return math.prod(len(values) for values in self.grid.values())

    @property
    def size(self) -> int:
        """Number of flights; they are numbered from 1."""
        return self.points * self.draws

    @property
    def swept(self) -> tuple[str, ...]:
        """Keys that vary between flights, and the seed."""
        keys = (*self.grid, *self.draw)
        return keys if "seed" in (*keys, *self.fixed) else (*keys, "seed")

    def values(self, number: int) -> dict[str, Any]:
        """Return the input values of flight ``number``, determined by the file, the campaign's seed and the number.

        Flights are numbered through the draws of a point of the grid, then through the points, the last key fastest.
        All points have the same draws, so that points can be compared.
        """
        point, draw = divmod(number - 1, self.draws)
        values = {"seed": self.seed + draw, **self.fixed}
        for key, choices in reversed(list(self.grid.items())):
            point, place = divmod(point, len(choices))
            values[key] = choices[place]
        return values | {key: drawn(self.seed, draw, key, one) for key, one in self.draw.items()}

    def digest(self) -> str:
        """Return the digest of all inputs of the flights and of the program version, to compare campaigns."""
        swept = [self.seed, self.draws, self.fixed, self.grid, self.draw, self.landing]
        text = json.dumps([version("wingbeat"), self.name, swept, self.stock.texts()], default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def load_campaign(path: Path) -> Campaign:
    """Read a campaign file and every file that it names, and check its values.

    Each value of the grid and each end of a distribution is checked separately on the first flight. An error that
    occurs only for a combination of values is reported in a row of the table.

    Raises:
        InputError: the file cannot be read, a key is unknown, a grid empty, a value impossible; one line.
    """
    document = read_document(path, "campaign")
    with error_context(path):
        campaign = _campaign(path, document)
        _try_values(campaign)
    return campaign


def _campaign(path: Path, document: Mapping[str, Any]) -> Campaign:
    if not document:
        raise InputError("the file is empty: specify [grid] or [draw], and flights")
    check_keys(document, (*PLAIN, *SECTIONS))
    for section in SECTIONS:
        check_table(document.get(section, {}), section)
    fixed = dict(_flat(document.get("flight", {}), _is_value))
    grid = dict(_flat(document.get("grid", {}), _is_value))
    draw = dict(_flat(document.get("draw", {}), _is_distribution))
    _check_keys(fixed, grid, draw)
    found = {key: read_distribution(f"draw.{key}", table) for key, table in draw.items()}
    stock = load_stock(path.parent, *(_names(key, fixed, grid, found) for key in ("vehicle", "mission", "sticks")))
    seed = read_integer(document.get("seed", 1), "seed", Quantity("-", 0))
    draws = read_integer(document.get("flights", 1), "flights", Quantity("-", 1))
    campaign = Campaign(
        _name(path, document), str(document.get("title", "")), path, seed, draws, fixed, grid, found,
        _landing(document.get("landing", {})), stock,
    )  # fmt: skip
    if draw and "flights" not in document:
        raise InputError("[draw] needs flights = N: how often is drawn")
    if campaign.size > MOST:
        raise InputError(f"{campaign.size} flights; {MOST} are the most")
    return campaign


def _name(path: Path, document: Mapping[str, Any]) -> str:
    name = document.get("name", path.stem)
    if not isinstance(name, str) or not name or not all(letter.isalnum() or letter in "_-." for letter in name):
        raise InputError(f"name = {name!r} must be of letters, digits, _, - and .")
    return name


class _Landing(NamedTuple):
    sink: Annotated[float, Quantity("m/s", ABOVE_ZERO)] = Landing().sink
    bank_deg: Annotated[float, Quantity("deg", ABOVE_ZERO)] = math.degrees(Landing().bank)


def _landing(table: Mapping[str, Any]) -> Landing:
    limits = read_record(_Landing, table, "landing")
    return Landing(limits.sink, math.radians(limits.bank_deg) if "bank_deg" in table else Landing().bank)


def _is_value(entry: Any) -> bool:
    return not isinstance(entry, dict)


def _is_distribution(entry: Any) -> bool:
    """Whether a table is no section of further keys."""
    return not isinstance(entry, dict) or not entry or not all(isinstance(one, dict) for one in entry.values())


def _flat(section: Mapping[str, Any], leaf: Any, head: str = "") -> Iterator[tuple[str, Any]]:
    """Keys with dots and their entries, however the file nests them."""
    for key, entry in section.items():
        if leaf(entry):
            yield head + key, entry
        else:
            yield from _flat(entry, leaf, f"{head}{key}.")


def _check_keys(fixed: Values, grid: Values, draw: Values) -> None:
    for key in (*fixed, *grid, *draw):
        check_key(key)
    for key, times in Counter(map(_bare, (*fixed, *grid, *draw))).items():
        if times > 1:
            raise InputError(f"{key} is set {times} times in [flight], [grid] and [draw]; set it once")
    for key, values in grid.items():
        if not isinstance(values, list) or not values:
            raise InputError(f"grid.{key} must be a list of one value or more")
    for key, table in draw.items():
        if not isinstance(table, dict):
            raise InputError(f"draw.{key} must be a distribution, such as {{ uniform = [0.0, 4.0] }}")


def _bare(key: str) -> str:
    return key.removesuffix("_deg")


def _names(key: str, fixed: Values, grid: Values, draw: Mapping[str, Distribution]) -> list[str]:
    """All that a campaign calls by ``key``, a key whose values are names of files."""
    default = {"vehicle": [DEFAULT_VEHICLE], "mission": [DEFAULT_MISSION]}.get(key, [])
    names = [fixed[key]] if key in fixed else list(grid.get(key, default))
    if key in draw:
        names = list(draw[key].numbers)
    for name in names:
        check_value(key, name)
    return list(dict.fromkeys(names))


def _try_values(campaign: Campaign) -> None:
    """Put a flight together with each value by itself.

    Raises:
        InputError: one that cannot be.
    """
    for key, value in campaign.fixed.items():
        check_value(key, value)
    for key, one in campaign.draw.items():
        check_value(key, one.at(0.5))
    alternatives = list(_alternatives(campaign))
    for key, value in alternatives:
        check_value(key, value)
    _try_first(campaign, alternatives)
    for key, value in alternatives:
        if key != "seed":
            _try(campaign, key, value)


def _try_first(campaign: Campaign, alternatives: Sequence[tuple[str, Any]]) -> None:
    """Put the first flight together, or the last, before any value is blamed for what all flights have in common.

    Raises:
        InputError: neither can be flown; it names the key with another value of which the first could.
    """
    first = campaign.values(1)
    try:
        _try(campaign, "seed", first["seed"])
    except InputError as error:
        text = str(error)
        blamed = next((key for key, value in alternatives if _flies(campaign, first | {key: value})), "seed")
        told = blamed in text or blamed == "seed"
        raise InputError(text if told else f"{blamed} = {first[blamed]}: {text}") from None


def _flies(campaign: Campaign, values: dict[str, Any]) -> bool:
    """Whether a flight can be put together with these values."""
    try:
        prepare(campaign.stock, values)
    except InputError:
        return False
    return True


def _alternatives(campaign: Campaign) -> Iterator[tuple[str, Any]]:
    for key, values in campaign.grid.items():
        yield from ((key, value) for value in values)
    for key, one in campaign.draw.items():
        yield from ((key, value) for value in one.corners)


def _try(campaign: Campaign, key: str, value: Any) -> None:
    """Put the first flight together with a value, or the last: some values go with others alone.

    Raises:
        InputError: neither can be flown with it.
    """
    try:
        prepare(campaign.stock, campaign.values(1) | {key: value})
    except InputError as error:
        with contextlib.suppress(InputError):
            prepare(campaign.stock, campaign.values(campaign.size) | {key: value})
            return
        text = str(error)
        raise InputError(text if key in text or key == "seed" else f"{key} = {value}: {text}") from None


def flight_values(campaign: Campaign, number: int) -> dict[str, Any]:
    """Return the values of flight ``number`` after a check of the number.

    Raises:
        InputError: the campaign has no such flight.
    """
    if not 1 <= number <= campaign.size:
        raise InputError(f"{campaign.path} has flights 1 to {campaign.size}, not {number}")
    return campaign.values(number)
