"""Compilation at first use, and the message before it."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from groundstation.views.terminal import open_console
from sim_bridge.aerodynamics.models import is_compiled_separately
from sim_bridge.compiled import on_compilation
from sim_bridge.plant import Plant, physics_compiled
from sim_bridge.vehicles import SimulatedVehicle

COMPILING = "compiling the physics (once, about half a minute)"
COMPILING_AIR = "compiling the aerodynamic model (once, about half a minute)"
_told: set[str] = set()
COMPILING_METHODS = "compiling methods at first use (up to half a minute)"


def load_physics(vehicle: SimulatedVehicle, quiet: bool = False) -> None:
    """Compile the physics, and aerodynamics compiled separately, if the cache lacks them.

    The compilation is announced on stderr unless ``quiet``.

    Raises:
        InputError: invalid bodies of the vehicle.
    """
    with announced_air(vehicle, quiet):
        plant = Plant(vehicle)
    if not physics_compiled():
        with _reporting(COMPILING, quiet):
            plant.compile()


def announced_air(vehicle: SimulatedVehicle, quiet: bool = False) -> AbstractContextManager[None]:
    """Announce like `announced`, once, if the aerodynamic model of the vehicle is compiled separately."""
    if COMPILING_AIR in _told or not is_compiled_separately(vehicle.aerodynamics.model):
        return nullcontext()
    return announced(quiet, COMPILING_AIR)


@contextmanager
def announced(quiet: bool = False, words: str = COMPILING_METHODS) -> Iterator[None]:
    """Announce once on stderr when the compilation of a kernel that is not in the cache begins."""
    if quiet:
        yield
        return
    announcement = _Announcement(words)
    with on_compilation(announcement.print_once):
        yield


class _Announcement:
    """Line on stderr, printed at the first of several events."""

    def __init__(self, words: str) -> None:
        self._words, self._printed = words, False

    def print_once(self) -> None:
        if not self._printed:
            self._printed = True
            _told.add(self._words)
            print(self._words, file=sys.stderr, flush=True)


def _reporting(words: str, quiet: bool) -> AbstractContextManager[Any]:
    """Show ``words`` on a terminal during the block; without a terminal print a line."""
    console = open_console(quiet, stderr=True)
    if console.is_terminal:
        return console.status(words)
    if not quiet:
        print(words, file=sys.stderr, flush=True)
    return nullcontext()
