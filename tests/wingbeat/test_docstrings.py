"""Type hints by the source, which is where those of compiled records are."""

from __future__ import annotations

import importlib
import pkgutil
import types
from typing import Any, get_type_hints

import pytest

import avionics
from wingbeat import docstrings
from wingbeat.docstrings import hints_of_source, is_compiled, type_hints
from wingbeat.samples import ImuSample

COMPILED = ("estimation", "guidance", "mixing", "sensing", "stabilization", "tasks")
"""packages that ``WINGBEAT_COMPILED=1`` compiles"""


def records() -> list[Any]:
    """Every NamedTuple class of the flight code."""
    names = [one.name for one in pkgutil.walk_packages(avionics.__path__, "avionics.")]
    modules = [importlib.import_module(name) for name in names if name.split(".")[1] in COMPILED]
    return [
        kind
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and hasattr(kind, "_fields") and kind.__module__ == module.__name__
    ]


def test_hints_of_the_source_are_those_of_python() -> None:
    different = [one for one in records() if hints_of_source(one) != get_type_hints(one, include_extras=True)]
    assert not different
    assert len(records()) > 100


def test_an_extension_is_told_from_a_module(monkeypatch: pytest.MonkeyPatch) -> None:
    assert is_compiled("numpy._core._multiarray_umath")
    assert not is_compiled("wingbeat.docstrings")
    # Compiled, a record has erased types.
    erased = types.ModuleType("erased")
    erased.ImuSample = type("ImuSample", (), {"__module__": ImuSample.__module__, "__annotations__": {}})  # type: ignore[attr-defined]
    monkeypatch.setattr(docstrings, "is_compiled", lambda module: True)
    assert type_hints(erased.ImuSample) == get_type_hints(ImuSample, include_extras=True)
