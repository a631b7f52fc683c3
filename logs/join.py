"""Joins the recordings of one flight: the flight computer and the world each write their own file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from mcap.records import Metadata

from avionics.quantities import BadInput
from logs.container import Container, encode
from logs.copying import Part, copy
from logs.index import read_index
from logs.names import JOINED
from logs.placing import claim, draft, settle
from logs.reader import map_file
from logs.records import Damage


class Kept(NamedTuple):
    """A part that was not whole: its rest is not in the joined file."""

    path: Path
    damage: str
    """what is wrong with it, one line"""


def join(parts: Sequence[Path], out: Path) -> list[Kept]:
    """Write everything in ``parts`` to the new file ``out``, then remove the parts; return those that were kept.

    Chunks are copied as they are. ``out`` appears when it is whole. A part that was cut off or is damaged gives
    what is whole in it and is itself kept; ``out`` says so in its metadata `names.JOINED`.

    Raises:
        BadInput: ``out`` exists, a part is not an MCAP file, or the parts declare a channel differently; all parts
            are then still there.
    """
    if out.exists():
        raise BadInput(f"{out} exists: it is not overwritten")
    if not parts:
        raise BadInput(f"there is nothing to join to {out}")
    opened = [Part(data, read_index(data)) for data in map(map_file, parts)]
    kept = [
        Kept(path, "; ".join(part.index.damage))
        for path, part in zip(parts, opened, strict=True)
        if part.index.damage
    ]
    with draft(out) as (file, place):
        container = Container(file)
        try:
            copy(opened, container)
            if kept:
                note = Metadata(name=JOINED, metadata={each.path.name: each.damage for each in kept})
                container.metadata(encode(note), JOINED)
        except Damage as damage:
            raise BadInput(f"cannot join {', '.join(map(str, parts))}: {damage}") from None
        container.finish()
        settle(file)
        claim(place, out)
    for path in set(parts) - {each.path for each in kept}:
        path.unlink(missing_ok=True)
    return kept
