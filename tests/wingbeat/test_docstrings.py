"""Type hints by the source, where those of compiled records are."""

from __future__ import annotations

import importlib
import sys
from dataclasses import is_dataclass
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from setup import flight_code
from wingbeat import docstrings
from wingbeat.docstrings import field_texts, hints_of_source, is_compiled, type_hints
from wingbeat.samples import ImuSample

ROOT = Path(__file__).parents[2]


@pytest.fixture
def records(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Every NamedTuple and dataclass of the modules that can be compiled."""
    monkeypatch.chdir(ROOT)
    modules = [importlib.import_module(path.removesuffix(".py").replace("/", ".")) for path in flight_code()]
    return [
        kind
        for module in modules
        for kind in vars(module).values()
        if isinstance(kind, type) and kind.__module__ == module.__name__
        if hasattr(kind, "_fields") or is_dataclass(kind)
    ]


def test_hints_of_the_source_are_those_of_python(records: list[Any]) -> None:
    different = [one for one in records if hints_of_source(one) != get_type_hints(one, include_extras=True)]
    assert not different
    assert len(records) > 100


def test_the_hints_of_a_compiled_record_are_those_of_its_source(monkeypatch: pytest.MonkeyPatch) -> None:
    erased = type("ImuSample", (), {"__module__": ImuSample.__module__, "__annotations__": {}})
    assert type_hints(erased) == {}
    monkeypatch.setattr(docstrings, "is_compiled", lambda module: True)
    assert type_hints(erased) == get_type_hints(ImuSample, include_extras=True)


def test_an_extension_is_recognized_before_and_after_its_import(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert is_compiled("numpy._core._multiarray_umath")
    assert not is_compiled("wingbeat.docstrings")
    (tmp_path / f"extension_of_test{EXTENSION_SUFFIXES[0]}").touch()
    (tmp_path / "module_of_test.py").touch()
    monkeypatch.syspath_prepend(str(tmp_path))
    assert is_compiled("extension_of_test") and not is_compiled("module_of_test")
    assert not {"extension_of_test", "module_of_test"} & sys.modules.keys()


def test_a_module_without_a_file_has_no_source(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "typed_in", type(sys)("typed_in"))
    with pytest.raises(OSError, match="typed_in has no source file"):
        field_texts("typed_in")
