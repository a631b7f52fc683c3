"""Joining of the recordings of one flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from mcap.records import Metadata

from logs.container import Container, encode
from logs.copying import Part, copy
from logs.index import read_index
from logs.log_file import map_file
from logs.names import FAULTS, JOINED
from logs.new_files import claim, draft, settle
from logs.recorder import RECORDING
from logs.records import Damage, parse
from wingbeat.errors import InputError


class Kept(NamedTuple):
    """Damaged part of a joined recording; the part is kept."""

    path: Path
    damage: str
    """its damage, one line"""


def join(parts: Sequence[Path], out: Path, faults: Mapping[str, str] | None = None) -> list[Kept]:
    """Join ``parts`` into the new file ``out``, then remove the parts; return the parts that were kept.

    Chunks are copied unchanged. ``out`` appears once it is complete. The intact content of a truncated or damaged
    part is copied, the part is kept, and its damage is recorded in the metadata `names.JOINED`. Tracebacks of
    ``faults`` of the ground station are recorded in the metadata `names.FAULTS`.

    Raises:
        InputError: ``out`` exists, a part is not an MCAP file, the parts are of different flights or declare a
            channel differently; no part is removed then.
    """
    if out.exists():
        raise InputError(f"{out} exists: it is not overwritten")
    if not parts:
        raise InputError(f"no recordings to join to {out}")
    opened = [Part(data, read_index(data)) for data in map(map_file, parts)]
    _check_same_flight(parts, opened)
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
            if faults:
                container.metadata(encode(Metadata(name=FAULTS, metadata=dict(faults))), FAULTS)
        except Damage as damage:
            raise InputError(f"cannot join {', '.join(map(str, parts))}: {damage}") from None
        container.finish()
        settle(file)
        claim(place, out)
    for path in set(parts) - {each.path for each in kept}:
        path.unlink(missing_ok=True)
    return kept


def _check_same_flight(paths: Sequence[Path], parts: Sequence[Part]) -> None:
    """Refuse recordings whose vehicle's clocks were not zero at the same nanosecond, as those of one flight are.

    Raises:
        InputError: there are such.
    """
    begun = {epoch: path for path, part in zip(paths, parts, strict=True) if (epoch := _epoch(part))}
    if len(begun) > 1:
        one, other, *_ = begun.values()
        raise InputError(f"{one} and {other} are not of one flight: they did not begin at the same instant")


def _epoch(part: Part) -> str:
    """ns since 1970 at which the vehicle's clock was zero, as it is written; empty where it is not."""
    with suppress(Damage):
        for span in part.index.metadata:
            record = parse(Metadata, part.data, span)
            if record.name == RECORDING:
                return str(record.metadata.get("start_epoch_ns", ""))
    return ""
