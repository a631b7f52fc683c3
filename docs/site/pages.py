"""Reference pages that are generated from the sources."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
from collections.abc import Callable
from typing import Any

import wingbeat
from avionics import topics as flight_topics
from avionics.vehicles.loader import SECTIONS
from groundstation.command.main import SUBCOMMANDS
from sim_bridge import topics as truth_topics
from sim_bridge.vehicles import SCHEMA
from wingbeat.docstrings import field_texts, split_unit
from wingbeat.schema import field_hints, quantity_of
from wingbeat.topic import Topic

PACKAGES = ("wingbeat", "avionics", "sim_bridge", "groundstation", "logs")


def api() -> str:
    """Public Python API, filled in by autodoc."""
    public = [getattr(wingbeat, name) for name in wingbeat.__all__]
    parts = [
        "# Python API\n",
        "Public names of `wingbeat`, loaded on first use: `import wingbeat` loads nothing else.\n",
        *(_autodoc("wingbeat", one.__qualname__, isinstance(one, type)) for one in public),
        _autodoc("logs.reader", "Log", True),
        _autodoc("logs.columns", "Columns", True),
        _autodoc("wingbeat.gym", "FlappingEnv", True),
        _autodoc("wingbeat.gym.vector", "FlappingVectorEnv", True),
    ]
    return "\n".join(parts)


def _autodoc(module: str, name: str, members: bool) -> str:
    kind = "autoclass" if members else "autofunction"
    options = "   :members:\n   :inherited-members: tuple, Mapping, Env, VectorEnv\n" if members else ""
    return f"## {name}\n\n```{{eval-rst}}\n.. {kind}:: {module}.{name}\n{options}```\n"


def command_line() -> str:
    """Help texts of all commands."""
    os.environ["COLUMNS"] = "100"
    parts = ["# Command line\n"]
    for name, command in SUBCOMMANDS.items():
        module = importlib.import_module(command.module)
        shown = io.StringIO()
        with contextlib.redirect_stdout(shown), contextlib.suppress(SystemExit):
            module.run(["--help"])
        parts.append(f"## wingbeat {name}\n\n```text\n{shown.getvalue().strip()}\n```\n")
    return "\n".join(parts)


def topics() -> str:
    """Topics with the fields of their messages."""
    parts = ["# Topics and fields\n", "Every message that a flight records. Rates in Hz; 0: on events.\n"]
    declared = [*vars(flight_topics).values(), *vars(truth_topics).values()]
    seen = {one.name: one for one in declared if isinstance(one, Topic)}
    for name, topic in sorted(seen.items()):
        message = topic.message
        about = " ".join((message.__doc__ or "").split())
        rate = "events" if not topic.rate else f"{topic.rate:g} Hz"
        parts.append(f"## {name}\n\n{about} ({message.__name__}, {rate})\n")
        parts.append(_table(("field", "unit", "meaning"), _fields(message)))
    return "\n".join(parts)


def vehicle_keys() -> str:
    """Keys of the vehicle files with units and ranges."""
    parts = [
        "# Vehicle keys\n",
        "`world.toml` is what is simulated, `avionics.toml` what the flight computer assumes.\n",
    ]
    world = {**SCHEMA.required, **SCHEMA.optional, **{f"{name}.NAME": one for name, one in SCHEMA.repeated.items()}}
    for title, sections in (("world.toml", world), ("avionics.toml", SECTIONS)):
        parts.append(f"## {title}\n")
        for name, record in sections.items():
            about = " ".join((record.__doc__ or "").split())
            parts.append(f"### [{name}]\n\n{about}\n")
            parts.append(_table(("key", "unit", "range", "default", "meaning"), _keys(record)))
    return "\n".join(parts)


def _fields(message: type[Any]) -> list[tuple[str, ...]]:
    texts = field_texts(message.__module__).get(message.__name__, {})
    return [(f"`{name}`", *split_unit(texts.get(name, ""))) for name in message._fields]


def _keys(record: type[Any]) -> list[tuple[str, ...]]:
    texts, rows = field_texts(record.__module__).get(record.__name__, {}), []
    for name, hint in field_hints(record).items():
        quantity = quantity_of(hint)
        unit = quantity.unit if quantity else "-"
        limits = f"{quantity.low:g} to {quantity.high:g}" if quantity else ""
        default = record._field_defaults.get(name, "required")
        text = " ".join(texts.get(name, "").split())
        rows.append((f"`{name}`", unit, limits, str(default), text))
    return rows


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    lines += [" | ".join(re.sub(r"\|", r"\\|", cell) for cell in row) for row in rows]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


SECTIONS_OF_THE_SITE = {
    "Tutorials": (
        "tutorials/first_flight", "tutorials/your_bird", "tutorials/px4_log", "tutorials/identify_and_tune",
        "tutorials/campaign", "tutorials/own_controller",
    ),
    "How-to guides": (
        "commands", "howto/choose_method", "howto/next_flight", "howto/tunnel", "howto/notebook", "own_aircraft",
        "identify_csv",
        "identification/user_model", "identification/flight_path", "log_check", "vibration", "web_view", "joystick",
        "howto/ground_stations", "sitl", "howto/hardware",
        "reference/serial_board", "reference/razor", "howto/add_vehicle", "howto/add_sensor",
        "howto/add_aerodynamics", "howto/add_control_law", "howto/add_estimator",
    ),
    "Reference": (
        "reference/api", "reference/command_line", "parameters", "reference/topics", "reference/vehicle_keys",
        "reference/mavlink", "reference/avionics", "reference/estimation", "reference/logs", "reference/importing",
        "reference/campaigns", "reference/groundstation", "reference/findings", "reference/estimators",
    ),
    "Explanation": (
        "explanation/flapping_flight", "explanation/short_period", "explanation/ahrs", "explanation/intervals",
        "explanation/papers",
    ),
    "Validation": (
        "validation/aerodynamics", "validation/estimation", "validation/identification", "validation/gusts",
        "validation/faults", "validation/new_bird", "validation/robo_raven", "validation/benchmarks",
    ),
}  # fmt: skip
"""pages by section, in the order of the navigation"""


def contents(packages: list[str]) -> dict[str, str]:
    """Page of each section by its name, and the table of contents of the first page (``index``)."""
    sections = {**SECTIONS_OF_THE_SITE, "Packages": tuple(page.removesuffix(".md") for page in packages)}
    found = {}
    for title, names in sections.items():
        tree = "\n".join(["```{toctree}", ":maxdepth: 1", "", *(f"/{name}" for name in names), "```"])
        found[title.lower().replace(" ", "_").replace("-", "_")] = f"# {title}\n\n{tree}\n"
    found["index"] = "\n".join(["\n\n```{toctree}", ":hidden:", "", *found, "```\n"])
    return found


GENERATED: dict[str, Callable[[], str]] = {
    "reference/api.md": api,
    "reference/command_line.md": command_line,
    "reference/topics.md": topics,
    "reference/vehicle_keys.md": vehicle_keys,
}
"""page to its writer"""
