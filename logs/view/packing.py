"""Numbers of the page as text: quantized, differenced, compressed.

A column becomes whole numbers of 16 or 32 bits. What is stored are their differences, which are small and alike, all
low bytes before all high bytes; zlib then leaves a half to a tenth. `decode.js` is the way back.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STEPS = 32767
"""Steps to each side of the center of a 16-bit column."""
ABSENT = {2: -(2**15), 4: -(2**31)}
"""Code of missing values, by bytes."""
_LEVEL = 6
"""level of zlib"""


class Packer:
    """Encoder of columns; `add` returns location and format of a column."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def add(self, values: Array, step: float | None = None) -> dict[str, float]:
        """Store a column.

        Args:
            values: NaN and infinity are stored as missing.
            step: resolution of 32-bit integers; without it the range of the column is divided into 16 bits.

        Keys: ``at`` (bytes), ``count``, ``width`` (bytes), ``step`` and ``middle``: a value is middle + step * whole.
        """
        width, middle = (2, _middle(values)) if step is None else (4, 0.0)
        size = _step(values, middle) if step is None else step
        self._store(_whole(values, middle, size, width))
        return {
            "at": self._size - width * len(values),
            "count": len(values),
            "width": width,
            "step": size,
            "middle": middle,
        }

    def text(self) -> str:
        """Return all columns, compressed by zlib, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), _LEVEL)).decode("ascii")

    def _store(self, whole: NDArray[Any]) -> None:
        # Differences wrap, and so do the sums of the decoder.
        change = np.diff(whole, prepend=whole.dtype.type(0))
        data = change.view(np.uint8).reshape(len(whole), whole.itemsize).T.tobytes()
        self._parts.append(data)
        self._size += len(data)


def _known(values: Array) -> Array:
    known = values[np.isfinite(values)]
    return known if len(known) else np.zeros(1)


def _middle(values: Array) -> float:
    known = _known(values)
    return float(0.5 * known.min() + 0.5 * known.max())


def _step(values: Array, middle: float) -> float:
    return float(np.max(np.abs(_known(values) - middle))) / STEPS or 1.0


def _whole(values: Array, middle: float, step: float, width: int) -> NDArray[Any]:
    limit = 2 ** (8 * width - 1) - 1
    known = np.isfinite(values)
    steps = np.clip(np.rint(np.where(known, values - middle, 0.0) / step), -limit, limit)
    return np.where(known, steps, ABSENT[width]).astype(f"<i{width}")
