"""Names of new recordings."""

from __future__ import annotations

import re
from datetime import datetime
from pathlib import Path

from logs.placing import numbered

RECORDINGS = Path("recordings")


def new_recording(vehicle: str, when: datetime | None = None, folder: Path = RECORDINGS) -> Path:
    """A path that is not taken, such as ``recordings/robo_raven_ii_d-20261121-131500.mcap``.

    Args:
        vehicle: name, or path of a vehicle file.
        when: local time of the flight; now when not given.
        folder: where recordings go; it is not created here.

    The same second again gives ``-2``, ``-3`` and so on.
    """
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", Path(vehicle).name.removesuffix(".toml")).strip("._-") or "flight"
    stamp = (when or datetime.now()).strftime("%Y%m%d-%H%M%S")
    return next(path for path in numbered(folder / f"{name}-{stamp}.mcap") if not path.exists())
