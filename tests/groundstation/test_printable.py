"""Text of files and links on the terminal: control characters, undecodable bytes and markup are shown, dropped."""

from __future__ import annotations

import io
import json
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.writer import CompressionType, Writer
from rich.table import Table

from groundstation.command.main import main
from groundstation.views.json_document import print_document
from groundstation.views.printable import PrintableStream, printable, printable_streams
from groundstation.views.terminal import PrintableConsole, open_console

HOSTILE = "a\x1b]0;OWNED\x07\x1b[2Jb\x9b1m\rc\u202ed [red]e[/red][/x]"
EPOCH = 10**18


def is_safe(text: str) -> bool:
    return all(character == "\n" or character.isprintable() for character in text)


@given(st.text(st.characters(codec=None)))
def test_printable_text_has_no_control_characters(text: str) -> None:
    shown = printable(text)
    assert not any(c != "\n" and (ord(c) < 0x20 or 0x7F <= ord(c) < 0xA0 or 0xD800 <= ord(c) < 0xE000) for c in shown)
    assert len(shown) == len(text)
    shown.encode()


def test_printable_keeps_ordinary_text() -> None:
    text = "α = 3.0° – 5 µs\nsecond line"
    assert printable(text) == text
    assert printable("\x1b\x7f\t") == "\u241b\u2421 "


def test_streams_are_filtered_and_restored(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout
    with printable_streams():
        sys.stdout.write(HOSTILE)
        sys.stderr.write(HOSTILE)
        assert isinstance(sys.stdout, PrintableStream)
    assert sys.stdout is before
    out, err = capsys.readouterr()
    assert is_safe(out) and is_safe(err) and "OWNED" in out and "[red]e[/red][/x]" in out


def test_console_shows_markup_and_controls_as_text() -> None:
    file = io.StringIO()
    console = PrintableConsole(
        file=file, force_terminal=True, color_system="truecolor", markup=False, highlight=False, width=120
    )
    table = Table("topic")
    table.add_row(HOSTILE)
    console.print(table, HOSTILE, style="bold")
    written = file.getvalue()
    assert "\x07" not in written and "\x9b" not in written and "\r" not in written
    assert "\x1b]" not in written and "\x1b[2J" not in written
    assert written.count("[red]") == 2
    assert "\x1b[1m" in written  # styles of our own remain


def test_every_console_is_of_this_kind() -> None:
    for stderr in (False, True):
        console = open_console(stderr=stderr)
        assert isinstance(console, PrintableConsole)
        assert console.render_str("[red]x[/red]").plain == "[red]x[/red]"


def test_json_escapes_what_a_terminal_would_obey(capsys: pytest.CaptureFixture[str]) -> None:
    with printable_streams():
        print_document({"text": HOSTILE})
    out = capsys.readouterr().out
    assert is_safe(out)
    assert json.loads(out)["text"] == HOSTILE


def test_log_info_of_a_hostile_topic(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "topic.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("", "test")
        channel = writer.register_channel("/" + HOSTILE, "json", writer.register_schema("thing", "jsonschema", b"{}"))
        for i in range(5):
            writer.add_message(channel, EPOCH + i * 10**7, b'{"x":1}', EPOCH + i * 10**7)
        writer.finish()
    assert main(["log", "info", str(path)]) == 0
    out = capsys.readouterr().out
    assert is_safe(out) and "OWNED" in out


def test_refusal_quotes_an_undecodable_file_name(capsys: pytest.CaptureFixture[str]) -> None:
    name = b"M\xfcn\x1b[2Jchen.mcap".decode("utf-8", "surrogateescape")
    assert main(["log", "info", name]) == 2
    assert is_safe(capsys.readouterr().err)
