"""What only the source tells: docstrings of fields, and type hints of compiled records."""

from __future__ import annotations

import ast
import functools
import sys
from collections.abc import Iterator
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints


def split_unit(text: str) -> tuple[str, str]:
    """Split a field's docstring, ``rad/s; about FRD x``, into unit and description, which may be missing."""
    unit, _, description = text.partition(";")
    return " ".join(unit.split()), " ".join(description.split())


@functools.cache
def field_texts(module: str) -> dict[str, dict[str, str]]:
    """Return field docstrings by class and field, for the top-level classes of an imported module.

    Raises:
        OSError: the source is not available.
    """
    return {name: dict(_texts_of(node)) for name, node in _classes(module).items()}


def type_hints(record: Any) -> dict[str, Any]:
    """Return the type hints of a record's fields, with the extras of `typing.Annotated`.

    A compiled module has erased types, ``tuple`` for ``tuple[float, ...]``: its source has the others.

    Raises:
        OSError: the source of a compiled module is not available.
    """
    if not is_compiled(record.__module__):
        return get_type_hints(record, include_extras=True)
    return hints_of_source(record)


def is_compiled(module: str) -> bool:
    """Return whether a module is an extension; one that is not imported is only located, by importing its package."""
    if module in sys.modules:
        file = getattr(sys.modules[module], "__file__", None)
    else:
        spec = find_spec(module)
        file = spec and spec.origin
    return str(file).endswith(tuple(EXTENSION_SUFFIXES))


def hints_of_source(record: Any) -> dict[str, Any]:
    """`type_hints` of a top-level record by the source of its module, with the names of the imported one.

    Raises:
        OSError: the source is not available.
    """
    fields = (one for one in _classes(record.__module__)[record.__name__].body if isinstance(one, ast.AnnAssign))
    hints = {one.target.id: ast.unparse(one.annotation) for one in fields if isinstance(one.target, ast.Name)}
    twin = type(record.__name__, (), {"__module__": record.__module__, "__annotations__": hints})
    return get_type_hints(twin, include_extras=True)


@functools.cache
def _classes(module: str) -> dict[str, ast.ClassDef]:
    file = getattr(sys.modules[module], "__file__", None)
    if file is None:
        raise OSError(f"{module} has no source file")
    path = Path(file)
    if path.suffix != ".py":
        path = path.with_name(module.rpartition(".")[2] + ".py")
    source = path.read_text(encoding="utf-8")
    return {node.name: node for node in ast.parse(source).body if isinstance(node, ast.ClassDef)}


def _texts_of(node: ast.ClassDef) -> Iterator[tuple[str, str]]:
    for field, after in zip(node.body, node.body[1:], strict=False):
        if not (isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)):
            continue
        if (
            isinstance(after, ast.Expr)
            and isinstance(after.value, ast.Constant)
            and isinstance(after.value.value, str)
        ):
            yield field.target.id, after.value.value
