"""The closing text of ``wingbeat fly``: one screen, and the block of README.md."""

from __future__ import annotations

import io
import re
from pathlib import Path

import wingbeat
from groundstation.command.fly import closing_parts
from groundstation.command.identify import identified
from groundstation.views.terminal import PrintableConsole, Stripped

README = Path(__file__).parents[2] / "README.md"
LINES, COLUMNS = 24, 80


def shown(log: Path, results: object, name: Path) -> list[str]:
    text = io.StringIO()
    console = PrintableConsole(file=Stripped(text), width=COLUMNS, highlight=False, markup=False)  # type: ignore[arg-type]
    with wingbeat.open_log(log) as opened:
        for part in closing_parts(name, wingbeat.Flight(opened).summary, results):  # type: ignore[arg-type]
            console.print(part, soft_wrap=True)
    return text.getvalue().splitlines()


def test_closing_text_is_that_of_the_readme(standard_flight: Path) -> None:
    with wingbeat.open_log(standard_flight) as opened:
        lines = shown(standard_flight, identified(opened, wings=False), Path("recordings/flight.mcap"))
    assert len(lines) + 2 <= LINES and max(map(len, lines)) <= COLUMNS
    blocks = re.findall(r"^```\n(.*?)^```", README.read_text(encoding="utf-8"), flags=re.S | re.M)
    assert "\n".join(lines).strip() in [block.strip() for block in blocks]


def test_flight_without_excitation_names_the_reason(standard_flight: Path) -> None:
    lines = shown(standard_flight, "no maneuver", standard_flight)
    assert "not identified: no maneuver" in lines
    assert f"wingbeat identify {standard_flight} --report report.html" in "\n".join(lines)
