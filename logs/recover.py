"""Repair of truncated or damaged logs."""

from __future__ import annotations

import mmap
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, NamedTuple

from mcap.writer import MCAP0_MAGIC

from logs.chunks import MAX_CHUNK_SIZE
from logs.container import Container
from logs.copying import Part, copy
from logs.file_lock import lock
from logs.index import Index, scan
from logs.join import join
from logs.log_file import map_file
from logs.names import parts_of
from logs.new_files import claim, draft, locked_name, numbered, settle
from logs.reader import open_log
from wingbeat.errors import InputError

LEFT = 8
"""-; number of the newest recordings of a folder to check: a flight leaves two or three"""


class Recovery(NamedTuple):
    """Result of a repair."""

    messages: int
    """messages in the repaired file"""
    damage: tuple[str, ...]
    """damage before the repair, one line each; empty if the file was intact and not changed"""
    torn: Path | None
    """file with the bytes that could not be read"""
    torn_bytes: int
    joined: tuple[Path, ...] = ()
    """recordings of world and flight computer that were joined to the file"""


def recover(path: Path | str, max_chunk_size: int = MAX_CHUNK_SIZE) -> Recovery:
    """Repair a log in place: its intact content replaces the file in one step.

    If the file does not exist but the recordings of its flight do (``NAME.world.mcap``, ``NAME.avionics.mcap``, as
    left by a killed flight), these are repaired and joined. Bytes that cannot be read are saved in ``<name>.torn``.
    An intact log is not changed. A symbolic link is resolved, and its target is repaired.

    Raises:
        InputError: not an MCAP file, being recorded or repaired just now, or the folder cannot be written to; the
            file is not changed then.
    """
    path = Path(os.path.realpath(path))
    parts = [] if path.exists() else parts_of(path)
    return _join_parts(path, parts, max_chunk_size) if parts else _recover(path, max_chunk_size)


def _join_parts(path: Path, parts: Sequence[Path], max_chunk_size: int) -> Recovery:
    """Repair the separate parts of a flight and join them to ``path``."""
    with locked_name(path) as ours:
        if not ours:
            raise InputError(f"{path} is being recorded: it cannot be repaired now")
        done, damage = {}, []
        for part in parts:
            try:
                one = done[part] = _recover(part, max_chunk_size)
            except InputError as reason:
                damage.append(f"{reason}: it is left as it is")
                continue
            damage += [f"{part.name}: {line}" for line in one.damage]
            damage += [f"{part.name}: {one.torn_bytes} bytes are in {one.torn}"] if one.torn else []
        if not done:
            raise InputError("; ".join(damage))
        join(list(done), path)
    torn = [one.torn for one in done.values() if one.torn is not None]
    lost = sum(one.torn_bytes for one in done.values())
    messages = sum(one.messages for one in done.values())
    return Recovery(messages, tuple(damage), torn[0] if torn else None, lost, tuple(done))


def _recover(path: Path, max_chunk_size: int) -> Recovery:
    with _locked(path):
        with open_log(path, max_chunk_size) as log:
            if log.complete and not log.verify():
                return Recovery(sum(info.messages for info in log.topics.values()), (), None, 0)
        data = map_file(path)
        index = scan(data, max_chunk_size)
        torn = _keep_torn(path, data, index)
        _replace(path, Part(data, index))
    lost = sum(end - start for start, end in index.dropped)
    damage = tuple(index.damage) or ("its summary did not match its content",)
    return Recovery(sum(index.counts.values()), damage, torn, lost)


def recover_left(folder: Path) -> list[tuple[Path, Recovery]]:
    """Repair unfinished logs among the newest recordings of a folder.

    The last bytes of the newest `LEFT` files are checked. Files that are being recorded or cannot be repaired are not
    changed.
    """
    done = []
    for path in _newest(folder):
        with suppress(InputError, OSError):
            if not _finished(path):
                done.append((path, recover(path)))
    return [(path, one) for path, one in done if one.damage]


def _newest(folder: Path) -> list[Path]:
    """Return the recordings, newest first; empty if the folder cannot be read."""
    with suppress(OSError):
        dated = sorted(((path.stat().st_mtime_ns, path) for path in folder.glob("*.mcap")), reverse=True)
        return [path for _, path in dated[:LEFT]]
    return []


def _finished(path: Path) -> bool:
    """Return whether a file ends like a finished MCAP file."""
    with path.open("rb") as file:
        file.seek(-min(len(MCAP0_MAGIC), path.stat().st_size), os.SEEK_END)
        return file.read() == MCAP0_MAGIC


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Acquire the recorder's lock on the file that has this name at this moment."""
    try:
        with path.open("rb") as file:
            lock(file)
            if os.fstat(file.fileno()).st_ino != path.stat().st_ino:
                raise InputError(f"{path} was replaced by another program: retry")
            yield
    except BlockingIOError:
        raise InputError(f"{path} is being recorded or repaired: it cannot be repaired now") from None
    except OSError as error:
        raise InputError(f"cannot repair {path}: {error.strerror or error}") from None


def _keep_torn(path: Path, data: mmap.mmap, index: Index) -> Path | None:
    """Write the bytes that cannot be read beside the log, one range after the other."""
    if not index.dropped:
        return None
    for place in numbered(path.with_name(path.name + ".torn")):
        if not place.exists():
            break
    with draft(place) as (file, name):
        for start, end in index.dropped:
            _write_all(file, data[start:end])
        settle(file)
        claim(name, place)
    return place


def _write_all(file: IO[bytes], data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[file.write(rest) :]


def _replace(path: Path, part: Part) -> None:
    with draft(path) as (file, name):
        container = Container(file)
        copy([part], container)
        container.finish()
        settle(file)
        shutil.copymode(path, name)
        name.replace(path)
