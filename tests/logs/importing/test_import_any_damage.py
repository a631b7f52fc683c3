"""A small log of every format, cut and mutated anywhere: it is imported, or refused in one line, within seconds."""

from __future__ import annotations

import random
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from foreign_logs import DATA, imported, new_dataflash, tlog
from test_import_c3d import c3d
from test_import_motion_capture import motive_csv, nexus_csv, wandering
from test_import_razor import binary_frame, text_frame

from logs.importing.log_import import FORMATS
from wingbeat.errors import InputError

SECONDS = 20
"""s; in which a file of some kilobytes must be imported or refused: it is milliseconds unless it never ends"""
MAPPING = '[time]\ncolumn = "t"\n[topics."/sensors/imu"]\ngyro_y = { column = "Q", unit = "deg/s" }\n'
SAMPLES: dict[str, tuple[str, str, Callable[[], bytes]]] = {
    "dataflash": ("dataflash", ".bin", lambda: new_dataflash(0.2).data),
    "ulog": ("ulog", ".ulg", lambda: (DATA / "vtol_bench.ulg").read_bytes()[:100_000]),
    "tlog": ("tlog", ".tlog", lambda: tlog(5)),
    "razor text": ("razor", ".razor", lambda: b"".join(text_frame(n) for n in range(20))),
    "razor binary": ("razor", ".razor", lambda: b"#SYNCH01\r\n" + binary_frame() * 9 + b"#SYNCH02\r\n"),
    "motive": ("motion capture", ".csv", lambda: motive_csv(wandering(1), 0.3).encode()),
    "nexus": ("motion capture", ".csv", lambda: nexus_csv(wandering(1), 0.3).encode()),
    "c3d": ("motion capture", ".c3d", lambda: c3d("<", True)),
    "table": ("csv", ".table", lambda: b"t,Q\n" + b"".join(b"%d,%d\n" % (n, n % 7) for n in range(50))),
    "mapping": ("csv", ".toml", MAPPING.encode),
}
"""Format, suffix and bytes of each; those of the mapping are mutated beside a whole table."""


def damaged(whole: bytes, seed: int) -> bytes:
    """Cut off (every third), or with up to five bytes flipped or put in anew, half of them near the beginning."""
    source, data = random.Random(seed), bytearray(whole)
    if seed % 3 == 0:
        return bytes(data[: source.randrange(len(data))])
    for _ in range(source.randint(1, 5)):
        at = source.randrange(min(len(data), source.choice((700, len(data)))))
        data[at] = source.choice((data[at] ^ 1 << source.randrange(8), source.randrange(256), ord(",\n"[seed % 2])))
    return bytes(data)


@contextmanager
def bounded() -> Iterator[None]:
    def stop(*_: Any) -> None:
        raise TimeoutError(f"it was not done in {SECONDS} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def attempt(folder: Path, name: str, data: bytes) -> str:
    """Import a sample's damaged bytes; the line with which they were refused, or nothing."""
    source, mapping = folder / f"sample{SAMPLES[name][1]}", folder / "map.toml"
    source.write_bytes(data)
    options: dict[str, Any] = {}
    if SAMPLES[name][0] == "csv":
        options = {"mapping": source if name == "mapping" else mapping}
        mapping.write_text(MAPPING)
    if name == "mapping":
        source = folder / "sample.table"
        source.write_bytes(SAMPLES["table"][2]())
    try:
        with bounded():
            imported(source, folder, **options)[0].unlink()
    except InputError as reason:
        assert str(reason).isprintable()
        return str(reason)
    return ""


def test_every_format_has_a_sample_which_is_imported(tmp_path: Path) -> None:
    assert {kind for kind, _, _ in SAMPLES.values()} == set(FORMATS)
    assert [attempt(tmp_path, name, made()) for name, (_, _, made) in SAMPLES.items()] == [""] * len(SAMPLES)


def attempt_all(folder: Path, name: str, count: int) -> None:
    whole = SAMPLES[name][2]()
    before = sorted(folder.iterdir())
    refused = [attempt(folder, name, damaged(whole, seed)) for seed in range(count)]
    assert before == [] and not list(folder.glob("*.mcap")) and len(refused) == count


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SAMPLES)
def test_damage_anywhere_is_imported_or_refused_in_one_line(tmp_path: Path, name: str) -> None:
    attempt_all(tmp_path, name, 20 if name == "ulog" else 60)


@pytest.mark.validate
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", SAMPLES)
def test_a_thousand_damages_of_every_format(tmp_path: Path, name: str) -> None:
    attempt_all(tmp_path, name, 1000)


def test_a_ulog_whose_definitions_end_in_a_false_length_is_not_read_for_ever(tmp_path: Path) -> None:
    """pyulog seeks back by the length that was told, which at the end of the file is more than it had read."""
    whole = SAMPLES["ulog"][2]()
    false = (20_000).to_bytes(2, "little") + b"\0"
    assert "no whole message of data" in attempt(tmp_path, "ulog", whole[:16] + false + b"rest")
