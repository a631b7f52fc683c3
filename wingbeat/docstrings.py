"""Docstrings of fields, which Python keeps only in the source."""

from __future__ import annotations

import ast
import functools
import inspect
import sys
from collections.abc import Iterator


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
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {node.name: dict(_texts_of(node)) for node in tree.body if isinstance(node, ast.ClassDef)}


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
