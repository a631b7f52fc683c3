"""What a wheel compiles, and what its modules may contain."""

from __future__ import annotations

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from setup import flight_code, requested

ROOT = Path(__file__).parents[1]


class Constant(NamedTuple):
    name: str
    is_final: bool
    is_fixed_tuple: bool


def constants(path: str) -> Iterator[Constant]:
    """The constants of a module that are assigned one by one."""
    module = importlib.import_module(path.removesuffix(".py").replace("/", "."))
    for node in ast.parse((ROOT / path).read_text(encoding="utf-8")).body:
        target = node.targets[0] if isinstance(node, ast.Assign) else getattr(node, "target", None)
        if not isinstance(target, ast.Name) or not (target.id.startswith("_") or target.id.isupper()):
            continue
        value, annotation = getattr(module, target.id), getattr(node, "annotation", None)
        annotated = ast.unparse(annotation) if annotation else ""
        if type(value).__name__ != "TypeVar":
            is_fixed_tuple = type(value) is tuple and "..." not in annotated
            yield Constant(f"{path}: {target.id}", annotated.startswith("Final"), is_fixed_tuple)


def test_constants_are_final_where_mypyc_can_read_them() -> None:
    """Compiled code looks other names up in a dictionary, but cannot read a `Final` of a tuple of fixed length."""
    every = [constant for path in flight_code() for constant in constants(path)]
    assert [constant.name for constant in every if constant.is_final == constant.is_fixed_tuple] == []
    assert sum(constant.is_final for constant in every) > 150


class Case(NamedTuple):
    environment: dict[str, str]
    command: str
    compiles: bool


@pytest.mark.parametrize(
    "case",
    [
        Case({"WINGBEAT_COMPILED": "1"}, "bdist_wheel", True),
        Case({"WINGBEAT_COMPILED": "1"}, "editable_wheel", False),
        Case({"WINGBEAT_COMPILED": "1"}, "sdist", False),
        Case({"WINGBEAT_COMPILED": "0"}, "bdist_wheel", False),
        Case({}, "bdist_wheel", False),
    ],
    ids=str,
)
def test_only_a_wheel_is_compiled_and_only_on_request(case: Case) -> None:
    compiles, needs = requested(case.environment, ["setup.py", case.command])
    assert compiles is case.compiles
    assert bool(needs) is (case.environment.get("WINGBEAT_COMPILED") == "1")
