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
"""-; flights of a campaign: a grid that multiplies to more was meant otherwise"""


class Campaign(NamedTuple):
    """A campaign whose file was read and checked."""

    name: str
    title: str
    path: Path
    seed: int
    """-; of the first draw; the flights of draw j have the seed ``seed + j``, counted from 0"""
    draws: int
    """-; flights of each point of the grid"""
    fixed: Values
    """what all flights have in common"""
    grid: Mapping[str, Sequence[Any]]
    draw: Mapping[str, Distribution]
    landing: Landing
    stock: Stock

    @property
    def points(self) -> int:
        """Of the grid; 1 without one."""
        return math.prod(len(values) for values in self.grid.values())

    @property
    def size(self) -> int:
        """How many flights there are; they are numbered from 1."""
        return self.points * self.draws

    @property
    def swept(self) -> tuple[str, ...]:
        """Keys that differ between flights, and the seed."""
        keys = (*self.grid, *self.draw)
        return keys if "seed" in (*keys, *self.fixed) else (*keys, "seed")

    def values(self, number: int) -> dict[str, Any]:
        """What enters flight ``number``: the file, the campaign's seed and the number alone decide it.

        Flights count through the draws of a point of the grid, then through the points, the last key fastest: every
        point is flown with the same draws, so that points can be compared.
        """
        point, draw = divmod(number - 1, self.draws)
        values = {"seed": self.seed + draw, **self.fixed}
        for key, choices in reversed(list(self.grid.items())):
            point, place = divmod(point, len(choices))
            values[key] = choices[place]
        return values | {key: drawn(self.seed, draw, key, one) for key, one in self.draw.items()}

    def digest(self) -> str:
        """Tells whether another campaign's flights are the same: by all that enters them, and our version."""
        swept = [self.seed, self.draws, self.fixed, self.grid, self.draw, self.landing]
        text = json.dumps([version("wingbeat"), self.name, swept, self.stock.texts()], default=str)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def load_campaign(path: Path) -> Campaign:
    """Read a campaign's file and every file that it names, and refuse what cannot be flown.

    Each value of the grid and each end of a distribution is tried by itself on the first flight; what goes wrong only
    where several meet is a row of the table.

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
    """`Campaign.values` of a number that somebody asked for.

    Raises:
        InputError: the campaign has no such flight.
    """
    if not 1 <= number <= campaign.size:
        raise InputError(f"{campaign.path} has flights 1 to {campaign.size}, not {number}")
    return campaign.values(number)
